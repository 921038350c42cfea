"""lrf3d"""

"""lrf2d"""

"""What a recording determines and what it leaves open, in words."""

"""The experiments of MSG-Cal (IROS 2015) on simulated and on recorded data."""

"""Base of the package, which imports nothing else of it: errors, checks, files, memory, processes, ADC cubes in memory and on
disk."""

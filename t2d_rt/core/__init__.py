"""The ground floor: errors, checks, files, memory, processes, ADC cubes in memory and on disk; it imports nothing of the rest."""

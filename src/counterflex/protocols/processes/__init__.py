"""What the processes of a run share: numbers in memory, signs of life, locks, requests of the operator."""

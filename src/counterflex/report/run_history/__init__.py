"""Pages of runs that have ended: history with trends, two runs beside each other, one run again."""

"""Program languages: readers and writers; motion in SI in the part frame, everything else kept as it was written."""

"""Text that programs of trackers export: one reader for each format, chosen by its name."""

"""Force sensors that send frames of a fixed length over UDP or TCP, described in the cell file."""

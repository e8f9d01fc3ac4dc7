"""ABB Externally Guided Motion: messages, check of a program, and the links of both modes."""

"""ABB RAPID: compensated programs, and programs whose path EGM corrects or streams."""

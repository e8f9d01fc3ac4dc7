"""Rules on an RSI set-up: ETHERNET file, context, wiring, program."""

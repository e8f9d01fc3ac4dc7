"""KUKA KRL: compensated programs, and programs whose path RSI corrects."""

"""What an operator says to a running loop, and what it shows: requests, status line."""

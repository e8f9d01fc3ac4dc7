"""The jobs: what the command line and any other front end call. Plain data in, plain data and files out."""

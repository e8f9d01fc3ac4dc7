"""The job ``identify production``: constants and wear from run logs of ordinary cuts."""

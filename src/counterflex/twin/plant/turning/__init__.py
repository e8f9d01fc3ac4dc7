"""The simulated cut of a tool whose axis turns or points elsewhere than along z of the part."""

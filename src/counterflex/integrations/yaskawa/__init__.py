"""Yaskawa: INFORM jobs of DX200 and YRC1000."""

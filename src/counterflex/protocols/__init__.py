"""Protocols of controllers and sensors: in each folder the telegram as pure bytes and the link (socket)."""

"""ATI Net F/T: records, scaling document, and the client."""

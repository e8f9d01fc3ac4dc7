"""Tool and base data of controllers as the start of a cell file, held against poses that the controller tells."""

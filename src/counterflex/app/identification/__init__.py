"""From measured data to a cell file: propose, check the data, identify, keep the history."""

"""Recipe ``payload``: zero, weight, centre of gravity, mounting and hose pack of the flange sensor."""

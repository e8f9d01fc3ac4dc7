"""Force sensors, whatever they speak: what the loop needs of one, protocols by name, samples of others checked."""

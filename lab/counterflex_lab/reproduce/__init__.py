"""Published experiments repeated on the simulated cell, over sockets."""

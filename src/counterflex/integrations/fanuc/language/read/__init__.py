"""Reading FANUC TP programs (.ls) as posts, ROBOGUIDE and the controller write them."""

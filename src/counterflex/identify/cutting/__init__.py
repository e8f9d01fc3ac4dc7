"""Recipe ``cutting``: force constants of tool and material from test cuts."""

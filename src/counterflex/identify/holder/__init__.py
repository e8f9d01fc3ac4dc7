"""Recipe ``holder``: sensitivities of a strain-gauge spindle holder."""

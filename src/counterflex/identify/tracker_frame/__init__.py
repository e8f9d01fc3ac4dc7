"""Recipe ``tracker-frame``: where the tracker stands and where its target sits."""

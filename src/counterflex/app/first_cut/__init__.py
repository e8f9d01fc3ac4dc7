"""First cut: a coupon is milled once and measured as a shop can; stiffness, force, play and friction follow from it."""

"""First cut: a coupon is milled once and measured as a shop can; stiffness and force of the cell follow from it."""

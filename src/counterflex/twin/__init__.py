"""The simulated robot cell: an elastic robot on an independent physics engine that really cuts the stock.

The twin is the truth that compensation is judged against. It shares geometry and catalogue data with the rest, never
the compliance, force or planning code.

What it has: rotational and translational elasticity at every body, own weight and gas cylinder, inertia, structural
damping, motor servo (P-PI with speed feed-forward), gear play, dry friction that sticks, geometry errors, the
controller's interpolation, corner rounding and acceleration, a part frame touched with the sagging robot, a stock that
the displaced tool really cuts, chips from its true motion with regeneration, ploughing and runout.

What it leaves out: modes of spindle and tool above about 200 Hz, tooth-passing ripple, gear transmission
error, wear, and the tilt of the tool in the chip. Heat and a hose pack are in some truths only, see
:mod:`counterflex.twin.truth.other`.
"""

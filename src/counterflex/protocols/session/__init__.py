"""One online session: telegram in, sensors drained, step, answer out, record handed over."""

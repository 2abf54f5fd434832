"""The loop: plan, slew, expose, reduce, follow, record."""

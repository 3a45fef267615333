"""What to run, and getting it run: config, plan, engines, status."""

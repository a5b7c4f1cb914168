"""What a log or link holds, what is wrong with it, and what to do about it, in plain sentences."""

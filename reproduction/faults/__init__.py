"""What the program does with spoilt files, kills and pages that misbehave."""

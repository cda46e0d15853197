"""Other methods and programs to compare with."""

"""What every room may use: errors, names, numbers in print, values that hold arrays, the one way to write files."""

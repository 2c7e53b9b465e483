"""What scores say: medians, intervals, choices. No HTML and no terminal here."""

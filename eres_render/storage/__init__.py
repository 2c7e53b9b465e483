"""Files that are whole or not there: writing, locking, checking and reading them."""

"""Write whole files, lock, check, hash and read them."""

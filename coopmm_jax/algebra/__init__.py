"""Small matrices made of scalars, and sine and cosine: what the equations are written in."""

"""The steps of Theorem 3.1's proof, (30)-(40), evaluated along a run."""

"""Pilots, blocks that toggle with known signs: their signal, their motion, the search for them."""

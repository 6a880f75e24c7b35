"""The robust adaptive motion/force controller of section III."""

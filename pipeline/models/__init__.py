"""The physics of the stands, named as in the papers."""

"""Mathematics that knows no gyroscope."""

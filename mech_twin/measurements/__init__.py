"""What a real machine gives: maps, foreign recordings and tables, data quality, sensors."""

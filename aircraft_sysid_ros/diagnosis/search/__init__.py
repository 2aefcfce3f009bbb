"""What each candidate explains on flight that was held out."""

"""What is right, by other code than the product's or by random draws whose truth is known."""

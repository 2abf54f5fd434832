"""What the operator is asked. STOP works in each of them."""

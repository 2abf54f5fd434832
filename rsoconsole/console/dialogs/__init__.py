"""Questions to the operator, as dialogs. STOP works in each of them."""

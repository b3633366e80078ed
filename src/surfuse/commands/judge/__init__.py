"""How good a map is: errors against truth, honest sigma, methods on equal readings."""

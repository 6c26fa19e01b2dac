"""How good the depth is: metrics, the paper's table and figure, and peers that do without a network."""

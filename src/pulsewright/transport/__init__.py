"""Links between a driver and a board, real or virtual."""

"""The state machine with its interlocks, explored exhaustively."""

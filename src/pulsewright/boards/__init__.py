"""The boards, one room each."""

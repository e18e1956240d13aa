"""What was chosen or learned on some sets and people, judged on others, with plain guesses beside."""

PARTS = ("distances",)

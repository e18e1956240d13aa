"""What was chosen on some people, on others: known and left-out people beside each other, and plain guesses.

Everything that is learned from people is learned on everybody for the numbers of known people, and on everybody but the
person who is judged for those of people left out. An estimate that is no better than a plain guess is said not to be.
"""

PARTS = ("waist", "legs", "feet", "flags", "variability", "asymmetry", "trials")

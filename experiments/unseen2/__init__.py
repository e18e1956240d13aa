"""What failed on recordings that no choice was made on, judged by people and sets left out, beside plain guesses."""

PARTS = ("feet", "widths", "legs_zero", "turned", "rates", "scales", "movements", "distances")

"""A gyroscope that is switched off part of the time (Udaya Shankar, Raveendranathan, Gans and Jafari 2010)."""

PARTS = ("table2", "tradeoff", "triggered", "behind", "turning", "knee", "figures", "rates")

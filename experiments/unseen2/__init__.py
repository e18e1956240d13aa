"""Parts of jgait judged on people, sets and movements on which nothing was chosen."""

PARTS = ("movements",)

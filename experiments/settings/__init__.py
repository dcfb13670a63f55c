"""What a command may be told: typed settings, and checks of them."""

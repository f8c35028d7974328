"""Many runs and the tables of docs/studies made of them."""

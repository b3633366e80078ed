"""Control laws of the joint servo, one file each; `law` says what a law is."""

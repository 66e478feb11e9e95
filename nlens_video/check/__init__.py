"""`nlens-video check`: whether a result is consistent in time with the plate it was made from."""

"""The flight software: what runs on the robot. Imports hal and nothing else of this project."""

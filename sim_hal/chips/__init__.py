"""Register-accurate models of the robot's chips, fed by the plant: what the real drivers talk to in a simulation."""

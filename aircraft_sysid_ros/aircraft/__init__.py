"""What an aeroplane is: frames, earth, atmosphere, geometry and mass, the aerodynamic model and its terms."""

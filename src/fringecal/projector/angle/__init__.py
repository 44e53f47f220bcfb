"""The projection angle from breaks of fringes, column by column, beside what stated positions ask for."""

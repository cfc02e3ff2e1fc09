"""The solver `chain`: chains of point masses, solved directly."""

#!/bin/sh
# Solve a mesh by CalculiX: solve.sh MESH OUT YOUNGS_MODULUS POISSONS_RATIO THICKNESS
# The tables of MESH have the form of CalculiX's data lines, so that a deck is made by pasting them together.
set -e
{
    echo "*NODE, NSET=ALL"
    cat "$1/nodes.csv"
    echo "*ELEMENT, TYPE=S8R, ELSET=SHELL"
    cat "$1/cells.csv"
    printf '*MATERIAL, NAME=M\n*ELASTIC\n%s, %s\n' "$3" "$4"
    printf '*SHELL SECTION, ELSET=SHELL, MATERIAL=M\n%s\n' "$5"
    echo "*BOUNDARY"
    cat "$1/held.csv"
    printf '*STEP\n*STATIC\n'
    if [ -s "$1/forces.csv" ]; then
        echo "*CLOAD"
        cat "$1/forces.csv"
    fi
    printf '*NODE PRINT, NSET=ALL\nU\n*END STEP\n'
} > job.inp
ccx -i job
cp job.dat "$2"

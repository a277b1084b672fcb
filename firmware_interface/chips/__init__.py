"""Registers, addresses and bit fields of the chips on the boards, from their data sheets."""

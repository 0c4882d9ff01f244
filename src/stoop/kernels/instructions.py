"""LLVM's text of code on vectors of doubles: terms of straight-line functions, loops, scratch memory.

A value of a candidate is an element of a vector, one per lane. The vector is as wide as a block of candidates, so a loop over
lanes is not written and nothing has to be vectorized; LLVM divides the vector among the registers of the processor.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

#: NaN and infinity are honest (neither ``nnan`` nor ``ninf``), so a diverging lane becomes NaN and no other lane notices
FLAGS = "reassoc nsz arcp contract afn"
ALIGNMENT = 64  #: bytes: a cache line


class Function:
    """One function of a module that is being written.

    Parameters
    ----------
    arguments : str
        As LLVM writes them: ``ptr noalias %P, i64 %count``.
    lanes : int
        Length of the vectors.
    """

    def __init__(self, arguments: str, lanes: int) -> None:
        self.arguments, self.lanes, self.vector = arguments, lanes, f"<{lanes} x double>"
        self._reserved: list[str] = []
        self._lines: list[str] = []
        self._names = 0

    def text(self) -> str:
        """Return the whole module; its function is named ``run``."""
        kind, names = f"v{self.lanes}f64", ("sqrt", "fabs")
        intrinsics = [f"declare {self.vector} @llvm.{f}.{kind}({self.vector})" for f in names]
        return "\n".join(
            [
                *intrinsics,
                "declare i64 @llvm.smin.i64(i64, i64)",
                # without a preference LLVM takes half of the register on several processors
                'attributes #0 = { nounwind "prefer-vector-width"="512" }',
                f"define void @run({self.arguments}) #0 {{",
                "entry:",
                *self._reserved,
                *_needed(self._lines),
                "  ret void",
                "}",
            ]
        )

    def write(self, line: str) -> None:
        """Write an instruction without a value, or a label."""
        self._lines.append(f"  {line}")

    def value(self, instruction: str) -> str:
        """Write an instruction; return the name of its value."""
        self._names += 1
        self._lines.append(f"  %v{self._names} = {instruction}")
        return f"%v{self._names}"

    def integer(self, operation: str, a: str | int, b: str | int) -> str:
        """Write ``add``, ``sub``, ``mul`` or ``lshr`` of two integers."""
        return self.value(f"{operation} i64 {a}, {b}")

    def least(self, a: str | int, b: str | int) -> str:
        """Write the lesser of two integers."""
        return self.value(f"call i64 @llvm.smin.i64(i64 {a}, i64 {b})")

    def element(self, array: str, index: str | int) -> str:
        """Write the address of an element of an array of eight bytes each."""
        return self.value(f"getelementptr inbounds i64, ptr {array}, i64 {index}")

    def load(self, array: str, index: str | int, kind: str = "double") -> str:
        """Write the load of an element."""
        return self.value(f"load {kind}, ptr {self.element(array, index)}, align 8")

    def store(self, number: str, array: str, index: str | int) -> None:
        """Write the store of a double."""
        self.write(f"store double {number}, ptr {self.element(array, index)}, align 8")

    def spread(self, number: str) -> Term:
        """Write the vector of one number in every lane."""
        first = self.value(f"insertelement {self.vector} poison, double {number}, i64 0")
        mask = f"<{self.lanes} x i32> zeroinitializer"
        return Term(self, self.value(f"shufflevector {self.vector} {first}, {self.vector} poison, {mask}"))

    def vector_at(self, array: str, index: str | int) -> Term:
        """Write the load of as many doubles as there are lanes, which begin anywhere."""
        return Term(self, self.value(f"load {self.vector}, ptr {self.element(array, index)}, align 8"))

    def literal(self, term: Any) -> str:
        """Return the text of a term or of a number that is the same in every lane."""
        if isinstance(term, Term):
            return term.name
        return f"<{', '.join([f'double {double(float(term))}'] * self.lanes)}>"

    def rows(self, count: int) -> Rows:
        """Reserve scratch memory on the stack, one vector a row."""
        name = f"%rows{len(self._reserved)}"
        self._reserved.append(f"  {name} = alloca [{max(count, 1)} x {self.vector}], align {ALIGNMENT}")
        return Rows(self, name, count)

    @contextmanager
    def loop(self, begin: str | int, end: str | int, step: int = 1) -> Iterator[str]:
        """Write a loop around what is written inside; its index counts up from `begin` below `end`."""
        self._names += 1
        here = self._names
        for block in (f"before{here}", f"head{here}"):
            self.write(f"br label %{block}")
            self.write(f"\n{block}:")
        self.write(f"%i{here} = phi i64 [ {begin}, %before{here} ], [ %next{here}, %end{here} ]")
        self.write(f"%more{here} = icmp slt i64 %i{here}, {end}")
        self.write(f"br i1 %more{here}, label %body{here}, label %after{here}")
        self.write(f"\nbody{here}:")
        yield f"%i{here}"
        for line in (f"br label %end{here}", f"\nend{here}:", f"%next{here} = add i64 %i{here}, {step}"):
            self.write(line)
        self.write(f"br label %head{here}")
        self.write(f"\nafter{here}:")

    @contextmanager
    def when(self, predicate: str, a: str, b: str | int) -> Iterator[None]:
        """Write a branch around what is written inside, taken where ``a predicate b`` holds for integers."""
        condition = self.value(f"icmp {predicate} i64 {a}, {b}")
        here = self._names
        self.write(f"br i1 {condition}, label %then{here}, label %else{here}")
        self.write(f"\nthen{here}:")
        yield
        self.write(f"br label %else{here}")
        self.write(f"\nelse{here}:")


_NAME = re.compile(r"%v\d+")


def _needed(lines: Sequence[str]) -> list[str]:
    """Return the lines without instructions whose values nothing needs; a value stands above all that need it."""
    kept, names = [], set[str]()
    for line in reversed(lines):
        value, *_ = found = _NAME.findall(line) or [""]
        if line.startswith(f"  {value} = "):
            if value not in names:
                continue
            found = found[1:]
        names.update(found)
        kept.append(line)
    return kept[::-1]


@dataclass(frozen=True)
class Rows:
    """Scratch memory: a vector a row."""

    code: Function
    name: str
    count: int

    def __getitem__(self, row: str | int) -> Term:
        code = self.code
        return Term(code, code.value(f"load {code.vector}, ptr {self._at(row)}, align {ALIGNMENT}"))

    def __setitem__(self, row: str | int, term: Any) -> None:
        value = f"{self.code.vector} {self.code.literal(term)}"
        self.code.write(f"store {value}, ptr {self._at(row)}, align {ALIGNMENT}")

    def __iter__(self) -> Iterator[Term]:
        return (self[i] for i in range(self.count))

    def fill(self, terms: Sequence[Any]) -> None:
        """Write the store of a term in each row."""
        for i, term in enumerate(terms):
            self[i] = term

    def place(self, row: str | int, lane: str) -> str:
        """Write the index of an element among the doubles of the rows."""
        code = self.code
        return code.integer("add", code.integer("mul", row, code.lanes), lane)

    def _at(self, row: str | int) -> str:
        return self.code.value(f"getelementptr inbounds {self.code.vector}, ptr {self.name}, i64 {row}")


def double(number: float) -> str:
    """Return a number as LLVM writes it: the bits of its double."""
    (bits,) = struct.unpack("<Q", struct.pack("<d", number))
    return f"0x{bits:016X}"


@dataclass(frozen=True, eq=False)
class Term:
    """A double of each lane; an operation writes its instruction."""

    code: Function
    name: str
    magnitude: bool = False  #: true where it is known to be zero or greater

    def binary(self, operation: str, a: Any, b: Any) -> Term:
        """Write an operation of two terms or numbers."""
        code = self.code
        operands = f"{code.literal(a)}, {code.literal(b)}"
        return Term(code, code.value(f"{operation} {FLAGS} {code.vector} {operands}"))

    def unary(self, function: str) -> Term:
        """Write an intrinsic function of LLVM: ``sqrt`` or ``fabs``."""
        code = self.code
        call = f"@llvm.{function}.v{code.lanes}f64({code.vector} {self.name})"
        return Term(code, code.value(f"call {FLAGS} {code.vector} {call}"), magnitude=True)

    def __add__(self, other: Any) -> Term:
        return self.binary("fadd", self, other)

    def __radd__(self, other: Any) -> Term:
        return self.binary("fadd", other, self)

    def __sub__(self, other: Any) -> Term:
        return self.binary("fsub", self, other)

    def __rsub__(self, other: Any) -> Term:
        return self.binary("fsub", other, self)

    def __mul__(self, other: Any) -> Term:
        return self.binary("fmul", self, other)

    def __rmul__(self, other: Any) -> Term:
        return self.binary("fmul", other, self)

    def __truediv__(self, other: Any) -> Term:
        return self.binary("fdiv", self, other)

    def __rtruediv__(self, other: Any) -> Term:
        return self.binary("fdiv", other, self)

    def __neg__(self) -> Term:
        return Term(self.code, self.code.value(f"fneg {FLAGS} {self.code.vector} {self.name}"))

    def __gt__(self, other: Any) -> Condition:
        return self._compare("ogt", other)

    def __lt__(self, other: Any) -> Condition:
        return self._compare("olt", other)

    def _compare(self, predicate: str, other: Any) -> Condition:
        code = self.code
        operands = f"{self.name}, {code.literal(other)}"
        return Condition(code, code.value(f"fcmp {predicate} {code.vector} {operands}"))


@dataclass(frozen=True, eq=False)
class Condition:
    """Truth or falsehood of each lane."""

    code: Function
    name: str

    def differs(self, other: Condition) -> Condition:
        """Write whether exactly one of two conditions holds."""
        kind = f"<{self.code.lanes} x i1>"
        return Condition(self.code, self.code.value(f"xor {kind} {self.name}, {other.name}"))

    def choose(self, a: Any, b: Any) -> Term:
        """Write `a` where the condition holds, else `b`."""
        code = self.code
        values = f"{code.vector} {code.literal(a)}, {code.vector} {code.literal(b)}"
        return Term(code, code.value(f"select <{code.lanes} x i1> {self.name}, {values}"))

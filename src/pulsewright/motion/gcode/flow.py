"""Which line comes next: O-words, subprograms, files of subroutines, and the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.interpreter import Interpreter
from pulsewright.motion.gcode.often import FAILURES, OFTEN, Run, run_from, values_of
from pulsewright.motion.gcode.parameters import LOCALS
from pulsewright.motion.gcode.reader import Label, Line, OWord, label_name
from pulsewright.motion.gcode.source import BLANK, Construct, Source

FEW: Final = 8
LONGEST_WAIT: Final = 63
LONGEST_NAME: Final = 200  # of a file, without its ending [byte]; systems take 251

_NOTHING: Final = (0.0,) * LOCALS
_CLOSE: Final = {"SUB": "endsub", "IF": "endif", "WHILE": "endwhile", "REPEAT": "endrepeat"}


@dataclass(slots=True)
class _Call:
    """A subroutine or subprogram that runs; what its caller wants back."""

    label: Label
    source: Source  # of the caller
    next: int  # line of the caller to go on with
    local: dict[str, float]
    numbered: list[float] | None = None  # None for M98, which shares those of its caller
    repeat: int = 0  # times that M98 is still to come
    first: int = 0  # its own first line
    counts: dict[int, int] = field(default_factory=dict)  # left of repeat loops, by their heads


class Flow:
    """Runs a program through an interpreter, line after line.

    Parameters
    ----------
    interpreter : Interpreter
        Carries out the lines.
    source : Source
        The program.
    bulk : callable, optional
        Carries out plain lines of the program from a line on; returns the first that is none.
    """

    def __init__(
        self,
        interpreter: Interpreter,
        source: Source,
        bulk: Callable[[int], int] | None = None,
    ) -> None:
        self._interpreter = interpreter
        self._bulk = bulk
        self._wait = self._waited = 0  # lines to go without it, as it found too few
        self._main = self._source = source
        self._next = 0
        self._calls: list[_Call] = []
        self._counts: dict[int, int] = {}  # of the main program
        self._loops = 0  # jumps back, so far
        self._left = interpreter.settings.max_lines + source.count
        self._percent = False  # the program began with %
        self._closed = False  # and it has come to its second one
        self._empty = True
        self._files: dict[Label, Source] = {}
        self._runs: dict[Line, Run | None] = {}
        self._value, self._has_value = 0.0, 0.0
        interpreter.parameters.predefined = {
            **interpreter.parameters.predefined,
            "_VALUE": lambda: self._value,
            "_VALUE_RETURNED": lambda: self._has_value,
            "_CALL_LEVEL": lambda: float(len(self._calls)),
        }
        self._keywords = {
            "": self._label,
            "SUB": self._sub,
            "ENDSUB": self._return,
            "RETURN": self._return,
            "CALL": self._call,
            "IF": self._if,
            "ELSEIF": self._else,
            "ELSE": self._else,
            "ENDIF": self._pass,
            "WHILE": self._while,
            "ENDWHILE": self._again,
            "DO": self._pass,
            "REPEAT": self._repeat,
            "ENDREPEAT": self._repeat_again,
            "BREAK": self._break,
            "CONTINUE": self._continue,
        }

    def run(self) -> None:
        """Carry out the program to its end.

        Raises
        ------
        GcodeError
            At the first line that cannot be done.
        """
        interpreter = self._interpreter
        interpreter.begin()
        try:
            while not (interpreter.ended or self._closed) and self._next < self._source.count:
                if self._bulk is not None and not (self._calls or self._loops):
                    self._run_bulk(self._bulk)
                else:
                    self._step()
            if self._calls and not interpreter.ended:
                name = label_name(self._calls[-1].label)
                raise Fault(f"the file ends within {name}, without endsub, return or M99")
            if self._percent and not (interpreter.ended or self._closed):
                raise Fault(
                    "the file began with % and ends without one; it may have been cut short"
                )
            interpreter.finish(percent=self._closed)
        except Fault as fault:
            raise self._error(fault) from None
        if self._empty:
            raise GcodeError("the program is empty: it holds no words", path=self._main.path)

    def _error(self, fault: Fault) -> GcodeError:
        """Return a fault with its file and line; one without a place is about the whole line."""
        i = min(self._next, self._source.count - 1)
        column, text = fault.column, fault.text
        if not column and i == self._next:
            line = self._source.text(i)
            text = line.strip()
            column = 1 + len(line) - len(line.lstrip())
        return GcodeError(
            fault.message, path=self._source.path, line=i + 1, column=column, text=text
        )

    def _run_bulk(self, bulk: Callable[[int], int]) -> None:
        """Carry out plain lines in bulk and the next one alone."""
        if self._waited < self._wait:
            self._waited += 1
        else:
            after = bulk(self._next)
            # Where plain lines are few, trying costs more than it brings.
            few = after - self._next < FEW
            self._wait, self._waited = min(2 * self._wait + 1, LONGEST_WAIT) if few else 0, 0
            self._empty = self._empty and after == self._next
            self._next = after
            if after >= self._source.count:
                return
        self._step()

    def _step(self) -> None:
        interpreter, i = self._interpreter, self._next
        self._left -= 1
        if self._left < 0:
            raise Fault(
                f"the program has carried out {interpreter.settings.max_lines} lines; if it is "
                "right that it goes on, raise max_lines"
            )
        line = self._source.lines.get(i) or self._line(i)
        if line is BLANK or (line.deleted and interpreter.settings.block_delete):
            self._next = i + 1
            return
        flow = line.flow
        if flow is not None:
            self._empty = False
            self._next = self._keywords[flow.keyword](flow, i)
            return
        interpreter.canon.line = i + 1
        if line.only_sets:
            if self._calls or self._loops:
                line.passes += 1
                if line.passes > OFTEN and self._set_many(line, i):
                    return
            line.set_parameters(interpreter.parameters)
        else:
            interpreter.execute(line)
        if self._empty:
            self._empty = not line.asks
        self._next = i + 1
        if interpreter.request is not None:
            self._serve(interpreter.request)

    def _set_many(self, line: Line, i: int) -> bool:
        """Carry out all lines from line ``i`` on that only set parameters, if that can be."""
        if line not in self._runs:
            self._runs[line] = run_from(self._source, i)
        run = self._runs[line]
        if run is None or run.lines > self._left:
            return False
        try:
            run.function(self._interpreter.parameters)
        except FAILURES:
            return False
        self._left -= run.lines - 1
        self._next = i + run.lines
        self._empty = False
        return True

    def _line(self, i: int) -> Line:
        """Return a line, read; a percent sign is a blank one."""
        try:
            return self._source.line(i, keep=bool(self._calls or self._loops))
        except Fault:
            if self._source.text(i).strip() != "%":
                raise
        self._closed = self._percent or not self._empty
        self._percent = True
        return BLANK

    def _serve(self, request: tuple[object, ...]) -> None:
        """Do what M98 or M99 asked for."""
        self._interpreter.request = None
        if request[0] == "call":
            _, label, repeat = request
            assert isinstance(label, int)
            assert isinstance(repeat, int)
            self._next -= 1  # faults are about this line
            self._call_program(label, repeat)
        elif self._calls and self._calls[-1].numbered is None:
            call = self._calls[-1]
            if call.repeat > 0:
                call.repeat -= 1
                self._interpreter.parameters.local = {}
                self._next = call.first
            else:
                self._leave()
        elif self._calls:
            self._next -= 1  # as above
            raise Fault(
                f"M99 ends a subprogram of M98, but {label_name(self._calls[-1].label)} is a "
                "subroutine; use return or endsub"
            )
        else:
            # On a machine the main program would begin again, for ever; here once is enough.
            self._interpreter.end(2)

    # One method for each keyword: it returns the next line

    def _label(self, word: OWord, i: int) -> int:
        return i + 1

    def _pass(self, word: OWord, i: int) -> int:
        self._construct(word, i)
        return i + 1

    def _construct(self, word: OWord, i: int) -> Construct:
        construct = self._source.flow.get(i)
        if construct is None:
            word.span.fail(f"{word.name} {word.keyword.lower()} belongs to nothing before it")
        if construct.tail < 0:
            close = _CLOSE.get(construct.keyword, "while")
            word.span.fail(
                f"{word.name} {construct.keyword.lower()} is not closed by {word.name} {close}"
            )
        return construct

    def _value_of(self, word: OWord) -> float:
        return self._values_of(word)[0]

    def _values_of(self, word: OWord) -> Sequence[float]:
        parameters = self._interpreter.parameters
        if word.function is not None:
            try:
                return word.function(parameters)
            except FAILURES:
                pass  # the fault is found below
        else:
            word.passes += 1
            if word.passes == OFTEN + 1:
                word.function = values_of(word.values)
        return [node.value(parameters) for node in word.values]

    def _sub(self, word: OWord, i: int) -> int:
        construct = self._construct(word, i)
        first = self._source.subroutines[construct.label]
        if first is not construct:
            word.span.fail(
                f"{word.name} sub is in line {first.head + 1} already; give each subroutine a "
                "number or name of its own"
            )
        return construct.after

    def _if(self, word: OWord, i: int) -> int:
        construct = self._construct(word, i)
        if self._value_of(word) != 0:
            return i + 1
        for branch in construct.branches:
            if branch > i:
                self._next = branch  # faults are about that line
                line = self._source.line(branch, keep=True)
                assert line.flow is not None
                if line.flow.keyword == "ELSE" or self._value_of(line.flow) != 0:
                    return branch + 1
        return construct.after

    def _else(self, word: OWord, i: int) -> int:
        return self._construct(word, i).after  # the branch before it has been done

    def _while(self, word: OWord, i: int) -> int:
        construct = self._construct(word, i)
        true = self._value_of(word) != 0
        if construct.keyword == "DO":
            return self._back(construct.head + 1) if true else i + 1
        return i + 1 if true else construct.after

    def _again(self, word: OWord, i: int) -> int:
        return self._back(self._construct(word, i).head)

    def _back(self, line: int) -> int:
        self._loops += 1
        return line

    def _repeat(self, word: OWord, i: int) -> int:
        construct = self._construct(word, i)
        count = round(self._value_of(word))
        self._repeats[construct.head] = count
        return i + 1 if count > 0 else construct.after

    @property
    def _repeats(self) -> dict[int, int]:
        return self._calls[-1].counts if self._calls else self._counts

    def _repeat_again(self, word: OWord, i: int) -> int:
        head = self._construct(word, i).head
        self._repeats[head] = left = self._repeats.get(head, 0) - 1
        return self._back(head + 1) if left > 0 else i + 1

    def _break(self, word: OWord, i: int) -> int:
        return self._construct(word, i).after

    def _continue(self, word: OWord, i: int) -> int:
        construct = self._construct(word, i)
        if construct.keyword == "WHILE":
            return self._back(construct.head)
        return construct.tail  # where the loop decides

    # Calls

    def _call(self, word: OWord, i: int) -> int:
        interpreter = self._interpreter
        parameters = interpreter.parameters
        label = word.label
        if label is None:
            assert word.node is not None
            value = word.node.value(parameters)
            label = round(value)
            if abs(value - label) > 1e-4:
                word.span.fail(f"a subroutine has a whole number, not {value:g}")
        if len(word.values) > LOCALS:
            word.span.fail(f"a call passes {LOCALS} values at most")
        arguments = self._values_of(word)
        source, construct = self._find(label, word)
        if construct.tail < 0:
            word.span.fail(f"{label_name(label)} sub is not closed by endsub")
        self._enter(
            _Call(label, self._source, i + 1, parameters.local, parameters.numbered[1 : LOCALS + 1])
        )
        parameters.local = {}
        parameters.numbered[1 : LOCALS + 1] = (*arguments, *_NOTHING[len(arguments) :])
        self._source = source
        return construct.head + 1

    def _enter(self, call: _Call) -> None:
        limit = self._interpreter.settings.max_depth
        if len(self._calls) >= limit:
            raise Fault(
                f"subroutines call each other {limit} deep; if it is right that they go on, "
                "raise max_depth"
            )
        self._calls.append(call)
        self._interpreter.kept.append(None)
        self._interpreter.restore_on_return.append(False)

    def _find(self, label: Label, word: OWord) -> tuple[Source, Construct]:
        """Return where a subroutine is: in this file, in the program, or in a file of its own."""
        for source in (self._source, self._main):
            construct = source.subroutines.get(label)
            if construct is not None:
                return source, construct
        name = str(label)
        if label not in self._files:
            path = self._file(name)
            if path is None:
                self._miss(label, word)
            self._files[label] = Source.from_file(path)
        source = self._files[label]
        if label not in source.subroutines:
            word.span.fail(f"{source.path} holds no {label_name(label)} sub")
        return source, source.subroutines[label]

    def _folders(self) -> list[Path]:
        return [Path(self._main.path).parent, *map(Path, self._interpreter.settings.subroutines)]

    def _file(self, name: str) -> Path | None:
        if "/" in name or "\\" in name or name.startswith("."):
            return None  # a label names a file of the search path, not any file
        if len(name.encode()) > LONGEST_NAME:
            return None
        candidates = (folder / f"{name}.ngc" for folder in self._folders())
        return next((path for path in candidates if path.is_file()), None)

    def _miss(self, label: Label, word: OWord) -> NoReturn:
        folders = ", ".join(str(folder) for folder in self._folders())
        word.span.fail(
            f"there is no {label_name(label)} sub in this program, and no {label}.ngc in {folders}"
        )

    def _return(self, word: OWord, i: int) -> int:
        if not self._calls or self._calls[-1].numbered is None:
            word.span.fail(f"{word.name} {word.keyword.lower()} outside of a running subroutine")
        value = self._value_of(word) if word.values else None
        self._leave()
        self._value, self._has_value = value or 0.0, float(value is not None)
        return self._next

    def _leave(self) -> None:
        interpreter = self._interpreter
        call = self._calls[-1]
        if interpreter.restore_on_return[-1] and interpreter.kept[-1] is not None:
            interpreter.restore_state()
        interpreter.kept.pop()
        interpreter.restore_on_return.pop()
        self._calls.pop()
        interpreter.parameters.local = call.local
        if call.numbered is not None:
            interpreter.parameters.numbered[1 : LOCALS + 1] = call.numbered
        self._source, self._next = call.source, call.next

    def _call_program(self, label: int, repeat: int) -> None:
        """Call a subprogram ``repeat`` times: M98."""
        caller = self._source
        source = next((s for s in (caller, self._main) if label in s.programs), None)
        if source is None and (path := self._file(str(label))) is not None:
            source = self._files.setdefault(label, Source.from_file(path))
        if source is None or label not in source.programs:
            raise Fault(f"there is no subprogram O{label} in this program or beside it")
        first = source.programs[label] + 1
        if repeat == 0:
            self._next += 1
            return
        parameters = self._interpreter.parameters
        self._enter(
            _Call(label, caller, self._next + 1, parameters.local, repeat=repeat - 1, first=first)
        )
        parameters.local = {}
        self._source, self._next = source, first

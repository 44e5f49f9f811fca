"""The grammar of Minibex: text to a tree. What it means stands in `minibex_meaning`.

file        = [ "constants" { constant ";" } ] parts "variables" variable { (";" | ",") variable } ";" parts
              [ "minimize" expression [";"] ] [ "constraints" block { ";" block } [";"] "end" | "end" ]
parts       = { function | "parameters" constant { (";" | ",") constant } ";" }
constant    = [ "*" ] name dimensions ("=" | "in") expression     "*": its value may be set by a program
variable    = name dimensions [ "in" expression ]
dimensions  = { "[" expression "]" }     at most three
function    = "function" name "(" name dimensions { "," name dimensions } ")"
              { name "=" expression ";" } "return" expression [";"] "end"
block       = "for" name "=" expression ":" expression ";" block { ";" block } [";"] "end"
            | expression ("=" | "<=" | ">=" | "<" | ">" | "in") expression | "integer" "(" expression ")"
            | "(" block ")" | name "=" expression     for a new name: what it stands for from there on
expression  : `minibex_expressions`
"""

from __future__ import annotations

from itertools import pairwise

from cpcal.common.errors import shown
from cpcal.problems.minibex_expressions import ExpressionParser
from cpcal.problems.minibex_tree import File, Function, Loop, Relation, Symbol, SyntaxNode
from cpcal.problems.tokens import Token

RELATIONS = ("=", "<=", ">=", "<", ">", "in")

_OPENING, _CLOSING = ("(", "["), (")", "]")


class Parser(ExpressionParser):
    """Of a whole file."""

    # the file ---------------------------------------------------------------------------------

    def file(self) -> File:
        constants: list[Symbol] = []
        if self.takes("constants"):
            while self.now.kind == "name" or self.now.text == "*":
                constants.append(self.constant())
                self.needs(";")
        functions, parameters = self.parts()
        if functions and self.now.kind == "end of file":
            self.fail("the file declares functions alone", "declare Variables, and Constraints or what to Minimize")
        self.needs("variables")
        variables = [self.variable()]
        while self.takes(";") or self.takes(","):
            if self.now.kind != "name" or self.now.text.lower() == "maximize":
                break
            variables.append(self.variable())
        more, further = self.parts()
        functions, parameters = functions + more, parameters + further
        goal = self.expression() if self.takes("minimize") else None
        self.takes(";")
        blocks: tuple[Relation | Loop, ...] = ()
        if self.takes("constraints"):
            self.takes(";")
            blocks = self.blocks()
        elif goal is None:
            largest = self.now.text.lower() == "maximize"
            remedy = "write Minimize and the negative" if largest else "say what is asked for, after a ;"
            self.fail(f"{self.told()} stands where Minimize or Constraints should", remedy)
        else:
            self.takes("end")
        if self.now.kind != "end of file":
            self.fail(f"{shown(self.now.text)} comes after the end", "take it out")
        return File(tuple(constants), tuple(variables), tuple(functions), goal, blocks, tuple(parameters))

    def parts(self) -> tuple[list[Function], list[Symbol]]:
        """Functions and parameters, in any order."""
        functions, parameters = list[Function](), list[Symbol]()
        while True:
            if self.takes("function"):
                functions.append(self.function())
            elif self.takes("parameters"):
                parameters.append(self.constant())
                while (self.takes(";") or self.takes(",")) and self.now.kind == "name":
                    parameters.append(self.constant())
            else:
                return functions, parameters

    def constant(self) -> Symbol:
        self.takes("*")
        token, dimensions = self.named()
        if self.takes("="):
            return Symbol(token, dimensions, self.expression(), thin=True)
        self.needs("in")
        return Symbol(token, dimensions, self.expression())

    def variable(self) -> Symbol:
        token, dimensions = self.named()
        return Symbol(token, dimensions, self.expression() if self.takes("in") else None)

    def named(self) -> tuple[Token, tuple[SyntaxNode, ...]]:
        token, dimensions = self.name(), []
        while self.takes("["):
            dimensions.append(self.expression())
            self.needs("]")
        if len(dimensions) > 3:
            raise self.source.wrong(f"{token.text} has {len(dimensions)} dimensions", "give at most three", token)
        return token, tuple(dimensions)

    def function(self) -> Function:
        token = self.name()
        self.needs("(")
        inputs = [Symbol(*self.named())]
        while self.takes(","):
            inputs.append(Symbol(*self.named()))
        self.needs(")")
        steps = []
        while self.now.kind == "name":
            left = self.name()
            self.needs("=")
            steps.append((left, self.expression()))
            self.needs(";")
        self.needs("return")
        result = self.expression()
        self.takes(";")
        self.needs("end")
        return Function(token, tuple(inputs), tuple(steps), result)

    def blocks(self) -> tuple[Relation | Loop, ...]:
        """Up to "end", which is taken."""
        out: list[Relation | Loop] = []
        while not self.takes("end"):
            out.append(self.loop() if self.takes("for") else self.relation())
            if self.now.text != "end":
                self.needs(";")
        return tuple(out)

    def loop(self) -> Loop:
        self.deeper()
        name = self.name()
        self.needs("=")
        first = self.expression()
        self.needs(":")
        last = self.expression()
        self.needs(";")
        found = Loop(name, first, last, self.blocks())
        self.depth -= 1
        return found

    def relation(self) -> Relation:
        """In brackets or not."""
        if self.now.text == "(" and self.holds_relation():
            self.take()
            self.deeper()
            found = self.relation()
            self.needs(")")
            self.depth -= 1
            return found
        if self.now.text == "integer" and self.tokens[self.at + 1].text == "(":
            sign = self.take()
            self.needs("(")
            whole = Relation(sign, self.expression())
            self.needs(")")
            return whole
        left = self.expression()
        if self.now.text not in RELATIONS:
            self.fail(f"{self.told()} stands where a relation should", "write =, <=, >= or in")
        sign = self.take()
        right = self.expression()
        if self.now.text in RELATIONS:
            self.fail("a second relation follows", "write a <= b and b <= c as two constraints")
        return Relation(sign, left, right)

    def holds_relation(self) -> bool:
        """Whether the bracket that begins here is round a relation, not round an expression."""
        depth = 0
        for before, token in pairwise(self.tokens[self.at :]):
            depth += (before.text in _OPENING) - (before.text in _CLOSING)
            after_value = before.kind in ("number", "name") or before.text in (*_CLOSING, "'")
            if depth == 1 and token.text == "integer" and before.text == "(":
                return True
            if depth == 1 and token.text in RELATIONS and (after_value or token.text not in "<>"):
                return True
            if depth == 0 or token.text == ";":
                return False
        return False

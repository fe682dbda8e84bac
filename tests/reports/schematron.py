"""Judges XML files by a Schematron file in ISO form with XPath 2 (queryBinding xslt2): schematron.py RULES FILE...

Prints one line for each violated rule of role "error" or "warning", and a count. Exit status 1 where an error is
violated or a rule cannot be evaluated. Within a pattern a node is judged by the first rule that matches it.
Needs Debian's python3-lxml and python3-elementpath (XPath 2, independent of the program under test).
"""

import sys

from elementpath import XPath2Parser, XPathContext
from lxml import etree

SCH = "{http://purl.oclc.org/dsdl/schematron}"


class Judge:
    def __init__(self, rules):
        self.rules = etree.parse(rules).getroot()
        self.names = {n.get("prefix"): n.get("uri") for n in self.rules.iter(SCH + "ns")}
        self.names["xs"] = "http://www.w3.org/2001/XMLSchema"

    def value(self, document, node, expression, variables):
        tree = XPath2Parser(namespaces=self.names).parse(expression)
        return tree.get_results(XPathContext(root=document, item=node, variables=variables))

    def lets(self, document, node, parent, variables):
        out = dict(variables)
        for let in parent.findall(SCH + "let"):
            out[let.get("name")] = self.value(document, node, let.get("value"), out)
        return out

    def violations(self, document):
        """(role, sentence) of what is violated, and how many tests were made."""
        found, tests = [], 0
        root = document.getroot()
        for pattern in self.rules.iter(SCH + "pattern"):
            judged = set()
            variables = self.lets(document, root, pattern, {})
            for rule in pattern.findall(SCH + "rule"):
                context = rule.get("context")
                nodes = self.value(document, root, context if context.startswith("/") else "//" + context, variables)
                for node in nodes:
                    if isinstance(node, etree._Element):
                        if node in judged:
                            continue
                        judged.add(node)
                    local = self.lets(document, node, rule, variables)
                    for test in rule:
                        if test.tag not in (SCH + "assert", SCH + "report"):
                            continue
                        tests += 1
                        holds = self.value(document, node, "boolean(%s)" % test.get("test"), local)
                        if holds == (test.tag == SCH + "report"):
                            found.append((test.get("role"), " ".join("".join(test.itertext()).split())))
        return found, tests


def main():
    judge = Judge(sys.argv[1])
    status = 0
    for file in sys.argv[2:]:
        found, tests = judge.violations(etree.parse(file))
        for role, sentence in found:
            if role in ("error", "warning"):
                print("%s: %s: %s" % (file, role, sentence))
            if role == "error":
                status = 1
        print("%s: %d tests of the rules made" % (file, tests))
    return status


if __name__ == "__main__":
    sys.exit(main())

"""Many demonstrations out of few: what a tool did to things is cut out of a flight, moved to where they are, and flown.

A source is a recorded flight with states, by an expert or by hand. It is cut into segments (:mod:`.segments`), each the
tool's path relative to the thing that it is about; :mod:`.plan` moves a segment to where that thing is now;
:mod:`.generator` is the policy that flies from one to the next, so whatever records policies records it.

Source: A. Mandlekar et al., "MimicGen: A Data Generation System for Scalable Robot Learning using Human
Demonstrations", 2023, sections 4.1 to 4.3. There an action of the arm's end is transformed on a fixed base; here it is
the path of the tool, which whole-body control flies.
"""

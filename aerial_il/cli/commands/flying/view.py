"""Watch a flight: in a window where there is a screen, else on a page with its film and every trace beside it.

Without a recording the policy flies now. A window shows seed after seed until it is closed; a page, a film or a file
for rerun shows one flight, whose recording is kept beside it.

Example: aerial-il view robot=ua_quad_arm4 task=pick_place
Example: aerial-il view policy=runs/pick_bc tier=gusts seed=10003 out=failure.html
Example: aerial-il view recording=datasets/pick seed=3 viewer=rerun
Example: aerial-il view recording=datasets/pick seed=3 out=flight.png size=[1080,1920]
"""

from aerial_il.workflows.view import View, view

SETTINGS, run = View, view

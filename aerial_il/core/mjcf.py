"""What a scene (MJCF) may consist of when this process did not write it: a list of what is allowed.

Allowed is what our own writer makes, and what a robot or a task is usually described with. It names no files, runs no
code, stands for no more than it says, and every number of it is finite and in range. Names:
https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

import math
import re
from xml.etree.ElementTree import Element

from aerial_il.core.errors import InvalidValueError

MAX_BODIES, MAX_CELLS, MAX_NAME = 4_000, 16_000_000, 200
LARGEST = 1e12  # of any number that has no limit of its own
LIMITS = {
    "width": 4096, "height": 24_576, "offwidth": 8192, "offheight": 8192, "offsamples": 16, "shadowsize": 16_384,
    "numslices": 256, "numstacks": 256, "numquads": 64, "nuserdata": 100_000, "nuser_site": 100, "iterations": 1000,
    "ls_iterations": 1000, "noslip_iterations": 1000, "ccd_iterations": 1000, "maxhullvert": 20_000, "mass": 1e5,
    "density": 1e6, "num": 100,
}  # fmt: skip
MEMORY = re.compile(r"\d{1,3}M?|\d{1,6}K|-1")  # at most 999 MB
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
WORD = re.compile(r"[A-Za-z_][\w.:/+-]*")
NAMES = ("name", "model", "class", "childclass", "objname", "refname")  # any text; all else is numbers and words
REFERENCES = (
    "body", "body1", "body2", "geom", "geom1", "geom2", "site", "site1", "site2", "joint", "joint1", "joint2", "tendon",
    "tendon1", "tendon2", "actuator", "material", "mesh", "texture", "target", "sidesite", "subtree1", "subtree2",
    "jointinparent", "cranksite", "slidersite", "refsite",
)  # fmt: skip

_PLACED = "name class pos quat axisangle xyaxes zaxis euler "
_ACTUATOR = (
    "name class group ctrllimited forcelimited actlimited ctrlrange forcerange actrange gear joint jointinparent site "
    "refsite tendon body cranklength cranksite slidersite actearly dyntype gaintype biastype dynprm gainprm biasprm "
    "kp kv dampratio timeconst inheritrange damping armature ctrlgroup "
)
_SENSOR = "name noise cutoff site joint actuator tendon body objtype objname reftype refname "
_SENSORS = (
    "accelerometer gyro velocimeter force torque magnetometer rangefinder touch clock jointpos jointvel "
    "jointactuatorfrc tendonpos tendonvel tendonactuatorfrc actuatorpos actuatorvel actuatorfrc ballquat ballangvel "
    "jointlimitpos jointlimitvel jointlimitfrc framepos framequat framexaxis frameyaxis framezaxis framelinvel "
    "frameangvel framelinacc frameangacc subtreecom subtreelinvel subtreeangmom e_potential e_kinetic"
)
_JOINT = (
    "name class type group pos axis springdamper limited actuatorfrclimited solreflimit solimplimit solreffriction "
    "solimpfriction stiffness range actuatorfrcrange actuatorgravcomp margin ref springref armature damping "
    "frictionloss coef joint joint1 joint2 polycoef active solref solimp "
)
ALLOWED = {
    "mujoco": "model",
    "compiler": "angle autolimits boundmass boundinertia settotalmass balanceinertia coordinate discardvisual eulerseq "
    "fusestatic inertiafromgeom inertiagrouprange alignfree saveinertial exactmeshinertia",
    "option": "timestep apirate impratio tolerance ls_tolerance noslip_tolerance ccd_tolerance sleep_tolerance gravity "
    "wind magnetic density viscosity o_margin o_solref o_solimp o_friction integrator cone jacobian solver "
    "iterations ls_iterations noslip_iterations ccd_iterations actuatorgroupdisable",
    "flag": "constraint equality frictionloss limit contact passive spring damper gravity clampctrl warmstart "
    "filterparent actuation refsafe sensor midphase eulerdamp autoreset nativeccd island override energy fwdinv "
    "invdiscrete multiccd sleep diagexact",
    "size": "memory nuserdata nuser_site",
    "statistic": "meaninertia meanmass meansize extent center",
    "visual": "",
    "global": "cameraid orthographic fovy ipd azimuth elevation linewidth glow offwidth offheight realtime "
    "ellipsoidinertia bvactive",
    "quality": "shadowsize offsamples numslices numstacks numquads",
    "headlight": "ambient diffuse specular active",
    "map": "stiffness stiffnessrot force torque alpha fogstart fogend znear zfar haze shadowclip shadowscale "
    "actuatortendon",
    "scale": "forcewidth contactwidth contactheight connect com camera light selectpoint jointlength jointwidth "
    "actuatorlength actuatorwidth framelength framewidth constraint slidercrank frustum",
    "rgba": "fog haze force inertia joint actuator actuatornegative actuatorpositive com camera light selectpoint "
    "connect contactpoint contactforce contactfriction contacttorque contactgap rangefinder constraint slidercrank "
    "crankbroken frustum bv bvactive",
    "default": "class",
    "asset": "",
    "texture": "name type colorspace builtin rgb1 rgb2 mark markrgb random width height nchannel",
    "material": "name class texture texrepeat texuniform emission specular shininess reflectance metallic roughness "
    "rgba",
    "mesh": "name class vertex face normal texcoord scale refpos refquat inertia maxhullvert smoothnormal",
    "worldbody": "",
    "body": _PLACED + "childclass mocap gravcomp simple sleep",
    "frame": _PLACED + "childclass",
    "inertial": _PLACED + "mass diaginertia fullinertia",
    "joint": _JOINT,
    "freejoint": "name group align",
    "geom": _PLACED + "type contype conaffinity condim group priority size material friction mass density shellinertia "
    "solmix solref solimp margin gap fromto mesh fitscale rgba fluidshape fluidcoef geom sidesite",
    "site": _PLACED + "type group size fromto material rgba site user",
    "camera": _PLACED + "mode target projection orthographic fovy ipd resolution focal focalpixel principal "
    "principalpixel sensorsize",
    "light": _PLACED + "mode target type directional castshadow active dir diffuse ambient specular attenuation cutoff "
    "exponent intensity range bulbradius",
    "contact": "name class body1 body2 geom1 geom2 site subtree1 subtree2 num data reduce noise cutoff",
    "pair": "name class geom1 geom2 condim friction solref solimp solreffriction gap margin",
    "exclude": "name class body1 body2",
    "equality": "",
    "connect": "name class active solref solimp body1 body2 anchor site1 site2",
    "weld": "name class active solref solimp body1 body2 relpose anchor site1 site2 torquescale",
    "tendon": "name class active solref solimp tendon1 tendon2 polycoef",
    "fixed": _JOINT + "actuatorfrclimited actuatorfrcrange springlength rgba width material",
    "spatial": _JOINT + "actuatorfrclimited actuatorfrcrange springlength rgba width material",
    "pulley": "divisor",
    "actuator": "",
    "sensor": "",
    **dict.fromkeys(("general", "motor", "position", "velocity", "intvelocity", "damper"), _ACTUATOR + "input"),
    **dict.fromkeys(_SENSORS.split(), _SENSOR),
}
_ALLOWED = {tag: frozenset(attributes.split()) for tag, attributes in ALLOWED.items()}


def check_scene(root: Element, *, files: tuple[str, ...] = ()) -> None:
    """Require of the tree of an MJCF that it holds what is allowed and nothing else, and asks for no more than that.

    Args:
        files: names that meshes may take their shape from, as they are handed over beside the scene.

    Raises:
        InvalidValueError: it does not; the message names the element.
    """
    cells = bodies = 0
    for element in root.iter():
        _check_element(element, files)
        bodies += element.tag in ("body", "geom", "site")
        cells += _cells(element) if element.tag == "texture" else 0
    if bodies > MAX_BODIES:
        raise InvalidValueError(f"it has {bodies} bodies, geoms and sites, more than {MAX_BODIES}")
    if cells > MAX_CELLS:
        raise InvalidValueError(f"its textures have {cells} pixels together, more than {MAX_CELLS}")


def _check_element(element: Element, files: tuple[str, ...]) -> None:
    if element.tag not in _ALLOWED:
        raise InvalidValueError(f"<{element.tag}> is not among the elements that are read")
    for name, text in element.attrib.items():
        if element.tag == "mesh" and name == "file" and text in files:
            continue
        if name not in _ALLOWED[element.tag]:
            raise InvalidValueError(f"<{element.tag} {name}=...> is not among the attributes that are read")
        if name in NAMES or name in REFERENCES:
            if len(text) > MAX_NAME:
                raise InvalidValueError(f"{name} of <{element.tag}> has {len(text)} characters, more than {MAX_NAME}")
        elif name == "memory":
            if not MEMORY.fullmatch(text):
                raise InvalidValueError(f"it asks for {text[:40]} of memory, more than 999M")
        else:
            _check_numbers(element.tag, name, text)


def _check_numbers(tag: str, name: str, text: str) -> None:
    """Require numbers that are finite and in range, or words that choose among what MuJoCo knows."""
    most = LIMITS.get(name, LARGEST)
    for token in text.split():
        if NUMBER.fullmatch(token):
            if not abs(float(token)) <= most:
                raise InvalidValueError(f"{name} of <{tag}> is {token[:40]}, beyond {most:g}")
        elif not (WORD.fullmatch(token) or token == "2d") or token == "muscle" or not math.isfinite(_as_number(token)):
            raise InvalidValueError(f"{name} of <{tag}> is {token[:40]!r}, which is no finite number")


def _as_number(token: str) -> float:
    """Return ``inf`` or ``nan`` where a word means one of them, else 0."""
    try:
        return float(token)
    except ValueError:
        return 0.0


def _cells(texture: Element) -> float:
    """Return the pixels of a texture that is drawn by MuJoCo; those of a cube are six squares."""
    width, height = (
        max((float(token) for token in texture.get(name, "").split() if NUMBER.fullmatch(token)), default=0.0)
        for name in ("width", "height")
    )
    return width * (height if texture.get("type") == "2d" else max(height, 6 * width))

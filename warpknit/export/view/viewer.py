"""The page of `warpknit view`: a slider over the records, colours by stress, and the numbers of what is clicked.

viser serves the page and all that it needs from this machine. The browser draws it, so turning and zooming ask nothing of this
process.
"""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import viser
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...base.errors import InputError, RunDirectoryError
from ...base.text import engineering, percent
from ...knit.cloth import CLASS_NAMES
from ...results.frame import Floats
from ..figures import TENSIONS, numbers_of
from ..mesh_figure import state_title, stress_colours
from ..plots import scale_of
from ..run_record import read_frame, read_run, state_files
from .drawing import SPHERES, Drawing, drawing_of

CONTACT_SIZE, CONTACT_SHARE = 2.6, 0.003  # radius over the wire radius, at least; over the distance of the full view
CONTACT_SPACE = 0.22  # radius over the mean spacing of contacts, at most
OPEN = np.array([165, 165, 165], dtype=np.uint8)  # colour of an open contact
WINDOW = 1.5  # repeats from the middle of the part that is drawn as tubes to its edge
UPDATE_EVERY = 2.0  # [s] for new records of a run that goes on
VIEW = np.array([0.0, -0.45, 0.9])  # direction from which a mesh is seen at first
FULL, NARROW = 0.58, 0.8  # half the picture's height over the mesh; height over width of the part beside the controls
LEAST_FORCE = 1e-3  # [uN] end of the scale of forces, at least
STRESS_SHARE = 99.5  # percent of the nodes whose stress is within the scale
FIELD = np.radians(25.0)  # of view: small, to see lengths side by side at one scale
THIN_LINE = 1.5  # pixels of a wire, at least
REACH = 0.01  # of the distance to the middle: how near a click has to be
FORCE_COLOURS = "winter"
NOTEBOOK_HEIGHT = 600  # pixels
ASK = "Click a wire or a contact."


class Viewer:
    """Records of a run, finished or not, on a page in the browser. Raises `RunDirectoryError` without records."""

    def __init__(self, directory: Path, *, host: str = "localhost", port: int = 8080) -> None:
        """port: the first free one from here on is taken."""
        self.directory = directory
        self.run = read_run(directory, also_running=True)
        self.layout = self.run.layout
        self.yield_stress = self.run.yield_stress
        self.highest, self.largest_force = 1e-9, LEAST_FORCE  # [MPa] stress that few nodes exceed; [uN] force of a contact
        self.peak = 0.0  # [MPa] largest stress
        self._ranged = 0  # number of records behind the scales
        self._widen()
        self.window: Floats | None = None  # (3,) [mm] middle of the part that is drawn as tubes; None: all is drawn
        self._chosen: tuple[bool, int, Floats] | None = None  # is it a contact, which one or point, and where [mm]
        self._lock = threading.RLock()
        last = len(state_files(directory)) - 1
        self.drawing = self.shown = self._read(last)  # of the record, and what of it is drawn
        low, high = self.drawing.points.min(axis=0), self.drawing.points.max(axis=0)
        self.middle, self.size = 0.5 * (low + high), high - low  # (3,) [mm] of the last record; the middle is the origin
        try:
            socket.create_server((host, 0)).close()  # viser would try many ports
        except OSError as error:
            raise InputError(f"--host: {host!r} is not this machine; give a name or address of it") from error
        with contextlib.redirect_stdout(io.StringIO()):  # a banner
            self.server = viser.ViserServer(host=host, port=port, label=f"warpknit: {directory.name}", verbose=False)
        self._build_page(last)
        self.show(last)

    def __repr__(self) -> str:
        return f"<Viewer of {self.directory} at {self.url}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="{NOTEBOOK_HEIGHT}" style="border: 0"></iframe>'

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def stop(self) -> None:
        """Close the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def wait(self) -> None:
        """Look for new records of the run until interrupted."""
        while True:
            time.sleep(UPDATE_EVERY)
            self.update()

    def update(self) -> None:
        """Read new records of the run; follow the last one if it is shown."""
        last = len(state_files(self.directory)) - 1
        if last >= self._ranged:
            was_last = self.record.value == self._ranged - 1
            self._widen()
            self.bars.image = self._bars()
            self.record.max, self.record.disabled = last, False
            if was_last:
                self.record.value = last

    def show(self, record: int) -> None:
        """Draw a record."""
        with self._lock:
            self.drawing, self._shown = self._read(record), record
            self._draw()

    def pick(self, origin: Floats, direction: Floats) -> None:
        """Show the numbers of a clicked wire or contact; in a line drawing, draw tubes about it."""
        with self._lock:
            shown, eye = self.shown, np.asarray(origin, dtype=float) + self.middle
            there = shown if self._shows_contacts else replace(shown, place=shown.place[:0])
            contact, point = there.pick(eye, direction, REACH * float(np.linalg.norm(eye - self._centre)))
            self._chosen = None
            if contact is not None:
                self._chosen = True, int(shown.number[contact]), shown.place[contact]
            elif point is not None:
                self._chosen = False, int(shown.index[point]), shown.points[point]
            if self._chosen is not None and self.drawing.sides == 0 and self.window is None:
                self._move_to(self._chosen[2])
            self._show_numbers()

    def _follow(self) -> None:
        """Draw the record of the slider, unless an earlier call has."""
        with self._lock:
            if self.record.value != self._shown:
                self.show(self.record.value)

    @property
    def _centre(self) -> Floats:
        """(3,) [mm] middle of what is drawn."""
        return self.middle if self.window is None else self.window

    @property
    def _shows_contacts(self) -> bool:
        return bool(self.contacts.value and 0 < len(self.shown.place) <= SPHERES)

    @property
    def _window_half(self) -> float:
        """[mm] half the width of the part that is drawn as tubes."""
        return float(WINDOW * np.max(1e3 * self.layout.period / np.maximum(self.layout.repeats, 1)))

    def _read(self, record: int) -> Drawing:
        self.frame = read_frame(state_files(self.directory)[record], self.layout)
        return drawing_of(self.layout, self.frame)

    def _build_page(self, last: int) -> None:
        server, gui = self.server, self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label("warpknit")
        server.scene.set_up_direction("+z")
        self.title = gui.add_markdown("")
        self.record: Any = gui.add_slider("record", 0, max(last, 1), 1, last, disabled=last == 0)
        self.contacts = gui.add_checkbox("contacts", True)
        self.note = gui.add_markdown("")
        self.whole = gui.add_button("whole mesh", visible=False)
        self.bars = gui.add_image(self._bars(), label="colours")
        self.picked = gui.add_markdown(ASK)
        self.record.on_update(lambda _: self._follow())
        self.contacts.on_update(lambda _: self._draw())
        self.whole.on_click(lambda _: self._move_to(None))
        camera, distance = server.initial_camera, self._distance()
        camera.position, camera.look_at, camera.fov = tuple(distance * VIEW), (0.0, 0.0, 0.0), FIELD
        camera.near, camera.far = 1e-3 * distance, 100.0 * distance

        @server.scene.on_click()
        def _(event: Any) -> None:
            self.pick(np.array(event.ray_origin), np.array(event.ray_direction))

    def _distance(self) -> float:
        """[mm] from which all that is drawn is seen."""
        across = self.size[:2] if self.window is None else np.full(2, 2.0 * self._window_half)
        return float(FULL * max(across[1], NARROW * across[0]) / np.tan(0.5 * FIELD))

    def _move_to(self, window: Floats | None) -> None:
        """Draw tubes about a place, or the whole mesh, and move the camera."""
        with self._lock:
            self.window = window
            self._draw()
            place, distance = self._centre - self.middle, self._distance()
            for client in self.server.get_clients().values():
                with client.atomic():
                    client.camera.position, client.camera.look_at = place + distance * VIEW, place

    def _draw(self) -> None:
        """Send what is shown to the page."""
        with self._lock:
            drawing, window = self.drawing, self.window
            if window is not None:
                self.shown = shown = drawing.within(window[:2] - self._window_half, window[:2] + self._window_half)
            else:
                self.shown = shown = drawing if drawing.sides else drawing.thinned()
            self.title.content = self._title()
            self.whole.visible = window is not None
            self.note.content = self._note()
            colour, points = self._stress_colours(shown), shown.points - self.middle
            with self.server.atomic():
                # lines within the tubes: a thin wire shows from afar
                ends = np.stack([shown.segment, shown.segment + 1], axis=1)
                self.server.scene.add_line_segments(
                    "/lines", points[ends].astype(np.float32), colour[ends], thickness=THIN_LINE, thickness_units="screen"
                )
                if sides := (0 if drawing.sides == 0 and window is None else shown.sides):
                    vertices, faces = shown.tubes(sides)
                    shade = np.repeat(_linear(colour), sides, axis=0)
                    tubes = trimesh.Trimesh(vertices - self.middle, faces, process=False, vertex_colors=shade)
                    self.server.scene.add_mesh_trimesh("/tubes", tubes)
                else:
                    self.server.scene.remove_by_name("/tubes")
                self._draw_contacts(shown)
                self._show_numbers()

    def _show_numbers(self) -> None:
        """Numbers of the clicked wire or contact, in the shown record."""
        name, text, shown, place = "", ASK, self.shown, np.zeros(3)
        if self._chosen is not None:
            is_contact, number, near = self._chosen
            places, numbers = (shown.place, shown.number) if is_contact else (shown.points, shown.index)
            if len(same := np.flatnonzero(numbers == number)):  # several in copies of a tile
                here = int(same[np.argmin(np.linalg.norm(places[same] - near, axis=1))])
                name = f"wire {shown.wire[here]}"
                if is_contact:
                    name = f"contact {number}" if number < self.layout.body_count else "contact between stitches"
                self._chosen, place = (is_contact, number, places[here]), places[here] - self.middle
                numerals = self._contact_text(shown, here) if is_contact else self._wire_text(shown, here)
                x, y, z = np.round(place, 3) + 0.0  # no negative zero
                text = f"**{name}**{numerals}  \n{x:.3f} mm weft, {y:.3f} mm warp, {z:.3f} mm height, from the middle"
        self.picked.content = text
        beside = place + [self._ball, self._ball, 0.0]
        self.server.scene.add_label("/picked", name, position=beside, anchor="bottom-left", visible=bool(name))

    def _draw_contacts(self, shown: Drawing) -> None:
        visible = self._shows_contacts
        space = np.sqrt(np.prod(np.ptp(shown.points[:, :2], axis=0)) / max(len(shown.place), 1))
        self._ball = size = max(CONTACT_SIZE * shown.radius, min(CONTACT_SHARE * self._distance(), CONTACT_SPACE * float(space)))
        is_elsewhere = shown.number >= self.layout.body_count
        for name, chosen, shape in (
            ("/contacts", ~is_elsewhere, trimesh.creation.icosphere(subdivisions=2, radius=size)),
            ("/elsewhere", is_elsewhere, trimesh.creation.box(extents=(1.5 * size,) * 3)),
        ):
            is_visible = visible and bool(chosen.any())
            place = shown.place[chosen] - self.middle if is_visible else np.zeros((1, 3))
            colour = self._force_colours(shown)[chosen] if is_visible else OPEN[None]
            self.server.scene.add_batched_meshes_simple(
                name, shape.vertices, shape.faces, np.tile([1.0, 0.0, 0.0, 0.0], (len(place), 1)), place,
                batched_colors=_linear(colour), visible=is_visible, cast_shadow=False, receive_shadow=False,
            )  # fmt: skip

    def _stress_colours(self, shown: Drawing) -> np.ndarray:
        """Colours (point, 3) 0 .. 255 by stress; beyond the scale the end colour, or yield's."""
        colours, scale = stress_colours(np.array([self.highest]), self.yield_stress)
        yields = False if self.yield_stress is None else shown.stress > 1e-6 * self.yield_stress
        inside = np.where(yields, np.inf, np.minimum(shown.stress, float(scale.vmax or 0.0)))
        return np.asarray(255 * colours(scale(inside))[:, :3], dtype=np.uint8)

    def _force_colours(self, shown: Drawing) -> np.ndarray:
        """(contact, 3) colours by force; grey: open."""
        mapped = ScalarMappable(Normalize(0.0, self.largest_force), FORCE_COLOURS).to_rgba(shown.force, bytes=True)[:, :3]
        return np.asarray(np.where(shown.is_active[:, None], mapped, OPEN))

    def _title(self) -> str:
        """Load, tension and active contacts of the record, as Markdown."""
        active = self.frame.body_active
        contacts = f"{np.count_nonzero(active):,} of {len(active):,} contacts active\n" if len(active) else ""
        if elsewhere := self.frame.elsewhere_force.size:
            contacts += f"{elsewhere:,} contacts between stitches (cubes)\n"
        state = state_title(self.frame, self._tension(), names_stage=True).replace("   ", "\n")
        return f"**{state}**\n{contacts}".replace("\n", "  \n")

    def _tension(self) -> list[float] | None:
        """[N/m] of the record in weft and warp; None where the history does not have it."""
        try:
            history = self.run.history()
        except RunDirectoryError:  # a run that has just begun
            return None
        return numbers_of(history, self.frame.index, *TENSIONS)

    def _contact_text(self, shown: Drawing, contact: int) -> str:
        number, bodies = int(shown.number[contact]), self.layout.body_count
        is_hook = number < bodies
        wires = self.layout.body_wires[number].tolist() if is_hook else divmod(number - bodies, self.layout.wire_count)
        wires = list(dict.fromkeys(wires))
        touching = f"wire {wires[0]}" if len(wires) == 1 else f"wires {wires[0]} and {wires[1]}"
        kind, force = "active" if shown.is_active[contact] else "open", engineering(1e-6 * float(shown.force[contact]), "N")
        if is_hook and self.layout.body_class.size:
            kind += f", class {CLASS_NAMES[self.layout.body_class[number]]}"
        return f", {kind}  \nforce {force}  \n{touching}"

    def _wire_text(self, shown: Drawing, point: int) -> str:
        stress = 1e6 * float(shown.stress[point])
        share = "" if self.yield_stress is None else f", {percent(stress / self.yield_stress, 0)} of the elastic limit"
        return f"  \nstress {engineering(stress, 'Pa')}{share}"

    def _note(self) -> str:
        """Note on parts that are not drawn."""
        total, drawn = len(self.drawing.segment), len(self.shown.segment)
        if self.window is not None:
            return f"Tubes within {self._window_half:.3g} mm of the place that was clicked."
        if self.drawing.sides:
            return ""
        many = f"{total:,} pieces of wire are too many for tubes: {drawn:,} {'' if drawn == total else 'longer '}lines."
        contacts = " Contacts are left out." if len(self.shown.place) > SPHERES else ""
        return f"{many}{contacts} Click a place to see its tubes and contacts."

    def _widen(self) -> None:
        """Extend the scales to stress and force of new records."""
        for path in (paths := state_files(self.directory))[self._ranged :]:
            frame = read_frame(path, self.layout)
            self.highest = max(self.highest, 1e-6 * float(np.percentile(frame.node_stress, STRESS_SHARE)))
            self.peak = max(self.peak, 1e-6 * float(np.max(frame.node_stress)))
            forces = np.append(frame.body_force, frame.elsewhere_force)
            self.largest_force = max(self.largest_force, 1e6 * float(np.max(forces, initial=0.0)))
        self._ranged = len(paths)

    def _bars(self) -> np.ndarray:
        """Picture of the colours of stress and of contact force."""
        figure = Figure(figsize=(3.2, 1.7), dpi=160)
        axes = figure.subplots(2, 1, gridspec_kw={"hspace": 2.6, "top": 0.95, "bottom": 0.28, "left": 0.06, "right": 0.94})
        colours, scale = stress_colours(np.array([self.highest]), self.yield_stress)
        most = f"largest {self.peak:.3g}" + ("" if self.yield_stress is None else f", yield at {1e-6 * self.yield_stress:.4g}")
        extend = "max" if self.yield_stress is not None and self.peak > 1e-6 * self.yield_stress else "neither"
        stress = figure.colorbar(ScalarMappable(scale, colours), cax=axes[0], orientation="horizontal", extend=extend)
        stress.set_label(f"wire stress at nodes [MPa]: {most}")
        factor, unit = scale_of("N", np.array([1e-6 * self.largest_force]))
        force = ScalarMappable(Normalize(0.0, 1e-6 * factor * self.largest_force), FORCE_COLOURS)
        figure.colorbar(force, cax=axes[1], orientation="horizontal").set_label(f"force of active contacts [{unit}]; grey: open")
        for one in axes:
            one.xaxis.set_major_locator(MaxNLocator(5))
            one.tick_params(labelsize=7)
            one.xaxis.label.set_size(7.5)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _linear(colour: np.ndarray) -> np.ndarray:
    """Screen colours 0 .. 255 as linear colours of a glTF file (IEC 61966-2-1)."""
    share = colour / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255.0 * light), dtype=np.uint8)

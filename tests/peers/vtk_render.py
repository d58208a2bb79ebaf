"""The CPU ray caster beside VTK's fixed-point one (VTK from PyPI): seconds for a picture of the same size and view at the same
step, the mean of a turn's, by turns, and the pictures into a folder; VTK's is the turn's last.

python3 tests/peers/vtk_render.py VOXROLE_VIEW VOXROLE OUT VOLUME...

VTK's transfer function is made from the regions that voxrole-view proposes: opaque within their values, and at their gradient
magnitudes. By value both have the same one, a curve over the volume's values. The first picture does not count, for which VTK builds its
tables of gradients and voxrole-view, by role, finds most of the cells that show something, nor does reading and making ready.
"""

import math
import os
import re
import statistics
import subprocess
import sys

import vtk

SIZE = 512
ROUNDS = 5
# Views of a turn; the first one does not count.
VIEWS = 6
FIELD_OF_VIEW = 30.0
AZIMUTH, ELEVATION = 30, 20
# Opacity and colour at shares of the range of values.
CURVE = [
    (0.0, "000000", 0.0),
    (0.2, "000000", 0.0),
    (0.26, "009E73", 0.23),
    (0.5, "56B4E9", 0.3),
    (0.54, "F0E442", 0.15),
    (0.75, "F0E442", 0.15),
]


def channels(colour):
    return [int(colour[at : at + 2], 16) / 255 for at in (0, 2, 4)]


def regions_of(view, file):
    text = subprocess.run(
        [view, "render", file, "-o", file + ".png", "--size", "16x16", "--cpu"], check=True, capture_output=True, text=True
    ).stdout
    regions = []
    for line in text.splitlines():
        value, gradient, colour, opacity = line.split()[1].split(",")[:4]
        numbers = lambda extent: [float(number) for number in extent.split(":")]
        regions.append((numbers(value), numbers(gradient), channels(colour), float(opacity)))
    return regions


class Vtk:
    def __init__(self, volume_file, regions=None):
        """By value where there are no regions."""
        reader = vtk.vtkNrrdReader()
        reader.SetFileName(volume_file)
        reader.Update()
        image = reader.GetOutput()
        self.mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        self.mapper.SetInputData(image)
        spacing = min(image.GetSpacing())
        self.mapper.SetAutoAdjustSampleDistances(False)
        self.mapper.LockSampleDistanceToInputSpacingOff()
        self.mapper.SetImageSampleDistance(1.0)
        self.mapper.SetSampleDistance(spacing)
        self.mapper.SetInteractiveSampleDistance(spacing)
        self.mapper.SetNumberOfThreads(os.cpu_count())
        low, high = image.GetScalarRange()
        self.curve = [(low + share * (high - low), colour, alpha) for share, colour, alpha in CURVE]
        volume = vtk.vtkVolume()
        volume.SetMapper(self.mapper)
        volume.SetProperty(self.by_value() if regions is None else self.of_regions(regions))
        renderer = vtk.vtkRenderer()
        renderer.AddVolume(volume)
        self.window = vtk.vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetSize(SIZE, SIZE)
        self.window.AddRenderer(renderer)
        bounds = image.GetBounds()
        self.centre = [0.5 * (bounds[2 * axis] + bounds[2 * axis + 1]) for axis in range(3)]
        self.radius = 0.5 * math.dist(bounds[0::2], bounds[1::2])
        self.camera = renderer.GetActiveCamera()
        self.camera.SetViewAngle(FIELD_OF_VIEW)
        self.renderer = renderer

    def property_of(self, opacity, colour):
        volume_property = vtk.vtkVolumeProperty()
        volume_property.SetScalarOpacity(opacity)
        volume_property.SetColor(colour)
        volume_property.SetInterpolationTypeToLinear()
        volume_property.ShadeOn()
        volume_property.SetScalarOpacityUnitDistance(self.mapper.GetSampleDistance())
        return volume_property

    def of_regions(self, regions):
        opacity, gradient_opacity = vtk.vtkPiecewiseFunction(), vtk.vtkPiecewiseFunction()
        colour = vtk.vtkColorTransferFunction()
        for (low, high), (weakest, strongest), rgb, alpha in regions:
            for value, alpha in [(low, 0.0), (low + 0.1 * (high - low), alpha), (high - 0.1 * (high - low), alpha), (high, 0.0)]:
                opacity.AddPoint(value, alpha)
            colour.AddRGBPoint(0.5 * (low + high), *rgb)
        weakest = min(region[1][0] for region in regions)
        gradient_opacity.AddPoint(0.0, 0.0)
        gradient_opacity.AddPoint(0.9 * weakest, 0.0)
        gradient_opacity.AddPoint(weakest, 1.0)
        volume_property = self.property_of(opacity, colour)
        volume_property.SetGradientOpacity(gradient_opacity)
        return volume_property

    def by_value(self):
        opacity, colour = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
        for value, rgb, alpha in self.curve:
            opacity.AddPoint(value, alpha)
            colour.AddRGBPoint(value, *channels(rgb))
        return self.property_of(opacity, colour)

    def draw(self, azimuth, elevation):
        """Seconds for a picture from where voxrole-view's `--camera AZIMUTH,ELEVATION` looks."""
        azimuth, elevation = math.radians(azimuth), math.radians(elevation)
        distance = self.radius / math.sin(math.radians(0.5 * FIELD_OF_VIEW))
        towards = [
            math.sin(azimuth) * math.cos(elevation),
            -math.cos(azimuth) * math.cos(elevation),
            math.sin(elevation),
        ]
        self.camera.SetFocalPoint(*self.centre)
        self.camera.SetPosition(*(centre + distance * along for centre, along in zip(self.centre, towards)))
        self.camera.SetViewUp(0, 0, 1)
        self.renderer.ResetCameraClippingRange()
        self.window.Render()
        return self.renderer.GetLastRenderTimeInSeconds()

    def save(self, file):
        grab = vtk.vtkWindowToImageFilter()
        grab.SetInput(self.window)
        grab.ReadFrontBufferOff()
        writer = vtk.vtkPNGWriter()
        writer.SetFileName(file)
        writer.SetInputConnection(grab.GetOutputPort())
        writer.Write()


def drawn(view, file, picture, regions, options, frames):
    said = subprocess.run(
        [view, "render", file, "-o", picture, "--size", f"{SIZE}x{SIZE}", "--cpu", "--stats", "--step", "1"]
        + ["--camera", f"{AZIMUTH},{ELEVATION}", "--frames", str(frames), *regions, *options],
        check=True,
        capture_output=True,
        text=True,
    ).stderr
    return float(re.search(r"drawn in ([0-9.]+) s", said)[1])


def drawn_later(*arguments):
    """Seconds for a picture of a turn, the first one left out."""
    return (drawn(*arguments, VIEWS) - drawn(*arguments, 1)) / (VIEWS - 1)


def main(view, voxrole, out, *volumes):
    os.makedirs(out, exist_ok=True)
    print("volume, classified by | voxrole, s | the same without integration, s | VTK, s | ratios")
    for volume in volumes:
        name = os.path.splitext(os.path.basename(volume))[0]
        packed, nrrd = os.path.join(out, name + ".vxr"), os.path.join(out, name + "-value.nrrd")
        if not os.path.exists(packed):
            subprocess.run([voxrole, "prepare", volume, "-o", packed], check=True, capture_output=True)
            subprocess.run([voxrole, "export", packed, "--field", "value", "-o", nrrd], check=True, capture_output=True)
        regions = regions_of(view, packed)
        peer = Vtk(nrrd)
        curve = ";".join(f"{value},{colour},{alpha}" for value, colour, alpha in peer.curve)
        typed = ["--classify", "value", f"--curve={curve}"]
        compare(view, os.path.join(out, name + "-by-value"), packed, peer, "value", typed)
        peer = Vtk(nrrd, regions)
        typed = []
        for (low, high), (weakest, strongest), rgb, alpha in regions:
            colour = "".join(f"{round(255 * channel):02x}" for channel in rgb)
            typed += ["--region", f"{low}:{high},{weakest}:{strongest},{colour},{alpha}"]
        compare(view, os.path.join(out, name), packed, peer, "regions", typed)


def compare(view, picture, packed, peer, by, typed):
    peer.draw(AZIMUTH, ELEVATION)
    turn = [AZIMUTH + 360 * number / VIEWS for number in range(1, VIEWS)]
    ours, plain, theirs = [], [], []
    for _ in range(ROUNDS):
        ours.append(drawn_later(view, packed, picture + ".png", typed, []))
        plain.append(drawn_later(view, packed, picture + "-post.png", typed, ["--integration", "post"]))
        theirs.append(statistics.mean(peer.draw(azimuth, ELEVATION) for azimuth in turn))
    peer.save(picture + "-vtk.png")
    times = [statistics.median(seconds) for seconds in (ours, plain, theirs)]
    ratios = [statistics.median(other / own for own, other in zip(seconds, theirs)) for seconds in (ours, plain)]
    label = f"{os.path.basename(packed)}, {by}"
    print(label, *(f"{time:.3f}" for time in times), ", ".join(f"{ratio:.2f}" for ratio in ratios), sep=" | ", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

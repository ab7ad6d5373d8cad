"""
A data set and a classifier
===========================

From a recipe to labelled samples, and from these to a classifier that is asked about sentences it has not seen. All
of it is tiny here; the same lines make thousands of samples.
"""

# %%
# A recipe
# --------
#
# A recipe says everything that the samples follow from: activities, how many sentences of each, how many persons and
# views of each sentence, the radar, the receiver's noise. Sentences come from a grammar, their motions from recorded
# clips and from key poses.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from t2d_rt.dataset import Dataset, Recipe, dataset_sheet, make_dataset, split
from t2d_rt.learn import maps_of
from t2d_rt.learn.baselines import baseline_probabilities

recipe = Recipe(
    name="tiny",
    classes=["walking", "running", "sitting"],
    descriptions_per_class=4,
    samples_per_description=1,
    angles_deg=[-30, 30],
    duration_s=3.0,
    radar="table2",
    conditions=[{"name": "ellipsoids", "method": "ellipsoid"}],
    seed=1,
)
folder = Path(tempfile.mkdtemp()) / "tiny"
print(make_dataset(recipe, folder, workers=1))

# %%
# The samples
# -----------
#
# A stopped run goes on where it was when the same line is called again. `t2d-rt dataset` does the same on the command
# line, with one process for each core.

dataset = Dataset(folder)
for record in dataset.records[:6]:
    print(f"{record['class']:8} {record['snr_db']:6.1f} dB SNR  {record['sentence']}")

# %%
# All samples on one sheet, a row for each class. Who runs is fastest, and who passes the radar goes over from coming
# to going. Who sits down or gets up moves for a moment, and hardly at all where that is seen from the side.

dataset_sheet(dataset, columns=4)

# %%
# A classifier
# ------------
#
# Samples of one sentence must not be on both sides, or the test asks for what was taught; `split` keeps descriptions
# apart. The classifier is the simplest there is: features of the Doppler envelope, and the class whose mean is
# nearest.

sides = split(dataset.records, (0.5, 0.5), apart=("description", "seed")).sides
maps = maps_of(dataset)
train, test = (maps.take(dataset.positions(each)) for each in sides.values())
probabilities = baseline_probabilities("nearest-centroid", train, test)
print(
    f"trained on {len(train)}, right in {np.mean(probabilities.argmax(axis=1) == test.labels):.0%} of the {len(test)} others"
)

# %%
# Which was taken for which? A row for each true class.

figure, ax = plt.subplots(figsize=(4, 3.4), layout="constrained")
counts = np.zeros((3, 3), dtype=int)
np.add.at(counts, (test.labels, probabilities.argmax(axis=1)), 1)
ax.imshow(counts, cmap="Blues", vmax=2 * counts.max())
for (row, column), count in np.ndenumerate(counts):
    ax.text(column, row, count, ha="center", va="center")
ax.set(xlabel="Class that was told", ylabel="True class", xticks=range(3), yticks=range(3))
ax.set_xticklabels(maps.classes)
ax.set_yticklabels(maps.classes)
figure

# %%
# So few samples show that all parts fit together, and no more. What a classifier is worth takes hundreds of samples,
# other persons and real recordings: the pages on classifiers and on real recordings tell what was measured.

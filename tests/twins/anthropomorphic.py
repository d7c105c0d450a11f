"""Eqs. 11-13 one slice and one point at a time."""

import statistics

import numpy as np

from twins.trajectory_field import instantaneous_field, samples


def gaussian_similarity(value, mean, deviation):
    """min(1, p(value) / p at two deviations), with the densities written out."""
    gaussian = statistics.NormalDist(mean, deviation)
    return min(1.0, gaussian.pdf(value) / gaussian.pdf(mean + 2.0 * deviation))


def lateral_position(trajectory, position):
    """y at the first crossing of x = position."""
    x, y = trajectory.x.tolist(), trajectory.y.tolist()
    if position <= x[0]:
        return y[0]
    for i in range(1, len(x)):
        if x[i] >= position:
            return y[i - 1] + (position - x[i - 1]) / (x[i] - x[i - 1]) * (y[i] - y[i - 1])
    return y[-1]


def length(trajectory, road, settings):
    """To the stop, to where it left the road, else to the road's end."""
    beside = trajectory.y[-1] < road.right_edge or trajectory.y[-1] > road.left_edge
    if trajectory.speed[-1] < settings.stop_speed or beside:
        return seen(trajectory, road, settings)
    return road.length - trajectory.x[0]


def seen(trajectory, road, settings):
    """How far it was seen."""
    x = trajectory.x.tolist()
    if max(x) >= road.length or x[-1] + (x[-1] - x[-2]) >= road.length:
        return road.length - x[0]
    return (x[-1] if trajectory.speed[-1] < settings.stop_speed else max(x)) - x[0]


def operations(time, active, neutral_time):
    """First and last sample of each: it ends where it was neutral for long enough."""
    found = []
    for i in np.flatnonzero(active):
        if found and (
            i == found[-1][1] + 1 or time[i] - time[found[-1][1] + 1] < neutral_time - 1e-6
        ):
            found[-1][1] = i
        else:
            found.append([i, i])
    return found


def count_operations(trajectory, settings):
    """Steering (by the wheel every angle is known) and pedals."""
    pedals = abs(trajectory.acceleration) > settings.acceleration_threshold
    count = len(operations(trajectory.time, pedals, settings.neutral_time))
    if settings.steering_rule == "manoeuvre":
        return count + manoeuvres(trajectory, settings)
    degrees = np.degrees(abs(trajectory.steering_wheel_angle))
    steering = degrees > settings.steering_threshold_deg
    return count + len(operations(trajectory.time, steering, settings.neutral_time))


def manoeuvres(trajectory, settings):
    """Moves to one side at more than 0.12 m/s, a mean over a second, that shift the vehicle by at
    least 1 m."""
    time, y = trajectory.time, trajectory.y
    around = np.clip([time - 0.5, time + 0.5], time[0], time[-1])
    rate = (np.diff(np.interp(around, time, y), axis=0) / np.diff(around, axis=0))[0]
    return sum(
        side * (y[last] - y[first]) >= 1.0
        for side in (-1.0, 1.0)
        for first, last in operations(time, side * rate > 0.12, settings.neutral_time)
    )


def anthropomorphic_index(ads, drivers, road, settings):
    """D_i, for drivers who end on the road or within one sample of its end."""
    lengths = [length(driver, road, settings) for driver in drivers]
    own = length(ads, road, settings)
    n_human = statistics.fmean(count_operations(driver, settings) for driver in drivers)
    n_ads = count_operations(ads, settings)
    length_factor = min(1.0, own / statistics.fmean(lengths))
    operation_factor = min(1.0, n_human / n_ads) if n_ads else 1.0

    driven = [seen(driver, road, settings) for driver in drivers]
    start, reach = float(ads.x[0]), min(seen(ads, road, settings), statistics.fmean(driven))
    slices = [start]
    while slices[-1] + settings.slice_spacing <= start + reach + 1e-6:
        slices.append(start + len(slices) * settings.slice_spacing)
    if start + reach - slices[-1] > 1e-6:
        slices.append(start + reach)

    sampled = [
        samples(trajectory, settings.field.sample_interval) for trajectory in (ads, *drivers)
    ]
    terms = []
    for x in slices:
        centre = lateral_position(ads, x)
        there = [
            d for d, reached in zip(drivers, driven, strict=True) if d.x[0] + reached >= x - 1e-6
        ]
        humans = [lateral_position(driver, x) for driver in (there if len(there) >= 2 else drivers)]
        deviation = max(statistics.stdev(humans), settings.centre_deviation_floor)
        centre_term = gaussian_similarity(centre, statistics.fmean(humans), deviation)
        right = max(0.0, min(settings.side_width, centre - road.right_edge))
        left = max(0.0, min(settings.side_width, road.left_edge - centre))
        n = settings.points_per_side
        for y in [centre - right * i / n for i in range(n, 0, -1)] + [
            centre + left * i / n for i in range(n + 1)
        ]:
            k1, k2 = settings.field.k1, settings.field.k2
            values = [instantaneous_field((x, y), some, k1, k2).sum() for some in sampled]
            mean = statistics.fmean(values[1:])
            deviation = max(statistics.stdev(values[1:]), settings.field_deviation_floor * mean)
            terms.append(centre_term * gaussian_similarity(values[0], mean, deviation))
    return length_factor * operation_factor * statistics.fmean(terms)

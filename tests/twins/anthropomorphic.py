"""Eqs. 11-13 one slice, one point and one driver at a time."""

import math
import statistics

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
    """Sample by sample: begin when active, end when neutral for long enough."""
    count, running, neutral_since = 0, False, math.nan
    for now, is_active in zip(time, active, strict=True):
        if running and not math.isnan(neutral_since) and now - neutral_since >= neutral_time - 1e-6:
            running = False
        if is_active:
            count += not running
            running, neutral_since = True, math.nan
        elif math.isnan(neutral_since):
            neutral_since = now
    return count


def count_operations(trajectory, settings):
    """Steering (by the wheel every angle is known) and pedals."""
    time = trajectory.time.tolist()
    pedals = [abs(a) > settings.acceleration_threshold for a in trajectory.acceleration]
    count = operations(time, pedals, settings.neutral_time)
    if settings.steering_rule == "manoeuvre":
        return count + manoeuvres(trajectory, settings)
    steering = [
        abs(math.degrees(a)) > settings.steering_threshold_deg
        for a in trajectory.steering_wheel_angle
    ]
    return count + operations(time, steering, settings.neutral_time)


def manoeuvres(trajectory, settings):
    """Moves to one side at more than 0.12 m/s, a mean over a second, that shift the vehicle by at
    least 1 m."""
    time, y = trajectory.time.tolist(), trajectory.y.tolist()

    def at(moment):
        moment = min(max(moment, time[0]), time[-1])
        after = next(i for i, t in enumerate(time) if t >= moment)
        if after == 0:
            return y[0]
        share = (moment - time[after - 1]) / (time[after] - time[after - 1])
        return y[after - 1] + share * (y[after] - y[after - 1])

    def rate(moment):
        span = min(moment + 0.5, time[-1]) - max(moment - 0.5, time[0])
        return (at(moment + 0.5) - at(moment - 0.5)) / span

    count = 0
    for side in (-1.0, 1.0):
        active = [side * rate(moment) > 0.12 for moment in time]
        first = last = neutral_since = None
        for i, moving in enumerate([*active, False]):
            over = i == len(active)
            rested = (
                neutral_since is not None
                and not over
                and time[i] - neutral_since >= settings.neutral_time - 1e-6
            )
            if first is not None and (over or (moving and rested)):
                count += side * (y[last] - y[first]) >= 1.0
                first = None
            if over:
                break
            if moving:
                first = i if first is None else first
                last, neutral_since = i, None
            elif neutral_since is None:
                neutral_since = time[i]
    return count


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
            values = [
                sum(instantaneous_field((x, y), sample, k1, k2) for sample in some)
                for some in sampled
            ]
            mean = statistics.fmean(values[1:])
            deviation = max(statistics.stdev(values[1:]), settings.field_deviation_floor * mean)
            terms.append(centre_term * gaussian_similarity(values[0], mean, deviation))
    return length_factor * operation_factor * statistics.fmean(terms)

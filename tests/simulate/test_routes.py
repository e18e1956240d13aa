import jax
import numpy as np
import pytest

from jgait.simulate import routes

_at = jax.jit(lambda way, distance: (routes.at(way, distance), routes.value_at(way, way.speed, distance)))


def there(way, *distances):
    """Places and speeds at up to five distances, of any route by one program."""
    place, speed = _at(routes.padded(way), np.resize(np.asarray(distances, float), 5))
    return jax.tree.map(lambda leaf: np.asarray(leaf)[: len(distances)], place), np.asarray(speed)


def test_a_corner_turns_by_its_angle_on_its_radius():
    way = routes.corner(3.0, np.pi / 2, 4.0, radius=1.0)
    place, _ = there(way, -1.0, 3.0, 3.0 + np.pi / 2, 3.0 + np.pi / 2 + 4.0, 10.0 + np.pi / 2)
    np.testing.assert_allclose(place.x, [-1.0, 3.0, 4.0, 4.0, 4.0], atol=1e-12)
    np.testing.assert_allclose(place.y, [0.0, 0.0, 1.0, 5.0, 8.0], atol=1e-12)  # and on beyond its ends
    np.testing.assert_allclose(place.heading, [0.0, 0.0, *[np.pi / 2] * 3], atol=1e-12)


@pytest.mark.parametrize("way", [routes.circle(2.0), routes.rectangle(5.0, 4.0), routes.rectangle(6.0, 3.0, laps=2)])
def test_closed_routes_close(way):
    end, _ = there(way, routes.total_length(way))
    np.testing.assert_allclose([end.x[0], end.y[0]], [0.0, 0.0], atol=1e-9)


def test_a_u_turn_comes_back_beside_where_it_began():
    way = routes.u_turn(6.0, radius=0.5)
    end, _ = there(way, routes.total_length(way))
    np.testing.assert_allclose([end.x[0], end.y[0], end.heading[0]], [0.0, 1.0, np.pi], atol=1e-12)


def test_a_turn_on_the_spot_stays_where_it_is_and_is_no_way():
    way = routes.about_turn(3.0, np.pi, steps=2.0)
    place, _ = there(way, 3.0, 4.0, 5.0, 8.0)
    np.testing.assert_allclose(place.x, [3.0, 3.0, 3.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(place.y, 0.0, atol=1e-12)
    np.testing.assert_allclose(place.heading, [0.0, np.pi / 2, np.pi, np.pi], atol=1e-12)
    np.testing.assert_allclose(place.walked, [3.0, 3.0, 3.0, 6.0], atol=1e-12)
    assert float(routes.walked_length(way)) == pytest.approx(6.0) and float(routes.total_length(way)) == 8.0


def test_slopes_rise_and_speeds_change_over_half_a_metre():
    way = routes.route({"length": 2.0}, {"length": 3.0, "slope": 0.1, "speed": 1.5})
    np.testing.assert_allclose(there(way, 1.0, 2.0, 5.0)[0].z, [0.0, 0.0, 0.3], atol=1e-12)
    _, speed = there(way, 0.0, 1.7, 2.0, 2.3, 4.0)
    np.testing.assert_allclose(speed, [1.0, 1.0, 1.25, 1.5, 1.5], atol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: routes.route(), "at least one piece"),
        (lambda: routes.route({"length": -1.0}), "length of a piece of a route must be positive; got -1"),
        (lambda: routes.route({"length": 1.0, "speed": 0.0}), "speed of a piece"),
        (lambda: routes.route({"length": 1.0, "bend": 2.0}), "got {'length': 1.0, 'bend': 2.0}"),
        (lambda: routes.rectangle(1.0, 5.0), "sides must be longer than two radii of 0.8 m; got 1 and 5 m"),
    ],
)
def test_impossible_routes_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()

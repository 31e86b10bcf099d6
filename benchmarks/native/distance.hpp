// Distances of points from flat shapes, metres.
#pragma once

#include <algorithm>
#include <cmath>

#include "problem.hpp"

namespace trailmark {

inline double squared_distance_to_segment(const Point& p, const Point& a, const Point& b) {
  const double ux = b[0] - a[0], uy = b[1] - a[1], vx = p[0] - a[0], vy = p[1] - a[1];
  const double length = ux * ux + uy * uy;
  const double t = length > 0.0 ? std::clamp((ux * vx + uy * vy) / length, 0.0, 1.0) : 0.0;
  const double dx = vx - t * ux, dy = vy - t * uy;
  return dx * dx + dy * dy;
}

inline double side(const Point& a, const Point& b, const Point& p) {
  return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
}

// Distance of a point from a triangle given counter-clockwise; 0 inside.
inline double distance_of(const Point& p, const Triangle& t) {
  if (side(t[0], t[1], p) >= 0.0 && side(t[1], t[2], p) >= 0.0 && side(t[2], t[0], p) >= 0.0) {
    return 0.0;
  }
  return std::sqrt(std::min({squared_distance_to_segment(p, t[0], t[1]), squared_distance_to_segment(p, t[1], t[2]),
                             squared_distance_to_segment(p, t[2], t[0])}));
}

inline double distance_of(const Point& p, const Disc& disc) {
  return std::max(0.0, std::hypot(p[0] - disc.center[0], p[1] - disc.center[1]) - disc.radius);
}

}  // namespace trailmark

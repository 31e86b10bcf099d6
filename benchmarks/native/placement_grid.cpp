#include "placement_grid.hpp"

#include <algorithm>
#include <cmath>

namespace trailmark {
namespace {

constexpr double kMaxCells = 1 << 18;
constexpr double kMaxSide = 8192;    // cells along a side
constexpr double kRounding = 1e-9;  // relative; keeps verdicts on the safe side

double squared_distance_to_segment(const Point& p, const Point& a, const Point& b) {
  const double ux = b[0] - a[0], uy = b[1] - a[1], vx = p[0] - a[0], vy = p[1] - a[1];
  const double length = ux * ux + uy * uy;
  const double t = length > 0.0 ? std::clamp((ux * vx + uy * vy) / length, 0.0, 1.0) : 0.0;
  const double dx = vx - t * ux, dy = vy - t * uy;
  return dx * dx + dy * dy;
}

double side(const Point& a, const Point& b, const Point& p) {
  return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
}

// Distance of a point from a triangle given counter-clockwise; 0 inside.
double distance(const Point& p, const Triangle& t) {
  if (side(t[0], t[1], p) >= 0.0 && side(t[1], t[2], p) >= 0.0 && side(t[2], t[0], p) >= 0.0) {
    return 0.0;
  }
  return std::sqrt(std::min({squared_distance_to_segment(p, t[0], t[1]), squared_distance_to_segment(p, t[1], t[2]),
                             squared_distance_to_segment(p, t[2], t[0])}));
}

double distance(const Point& p, const Disc& disc) {
  return std::max(0.0, std::hypot(p[0] - disc.center[0], p[1] - disc.center[1]) - disc.radius);
}

struct Box {
  double xmin, ymin, xmax, ymax;
};

Box box_of(const Triangle& t) {
  return {std::min({t[0][0], t[1][0], t[2][0]}), std::min({t[0][1], t[1][1], t[2][1]}),
          std::max({t[0][0], t[1][0], t[2][0]}), std::max({t[0][1], t[1][1], t[2][1]})};
}

Box box_of(const Disc& disc) {
  return {disc.center[0] - disc.radius, disc.center[1] - disc.radius, disc.center[0] + disc.radius,
          disc.center[1] + disc.radius};
}

}  // namespace

PlacementGrid::PlacementGrid(const Problem& problem) {
  const double width = problem.bounds[2] - problem.bounds[0], height = problem.bounds[3] - problem.bounds[1];
  const double size = std::max({0.25 * problem.robot.inscribed.radius, std::sqrt(width * height / kMaxCells),
                                std::max(width, height) / kMaxSide});
  x0_ = problem.bounds[0];
  y0_ = problem.bounds[1];
  per_metre_ = 1.0 / size;
  columns_ = static_cast<std::size_t>(std::ceil(width / size));
  rows_ = static_cast<std::size_t>(std::ceil(height / size));
  cells_.assign(columns_ * rows_, kClear);

  // No point of a cell is farther from its centre than this.
  const double half = size * std::sqrt(0.5) + kRounding * (std::abs(x0_) + std::abs(y0_) + width + height);
  const double clear = problem.robot.circumradius + half, hit = problem.robot.inscribed.radius - half;
  const auto index = [size](double from, double value, std::size_t count) {
    return static_cast<std::size_t>(std::clamp(std::floor((value - from) / size), 0.0, static_cast<double>(count - 1)));
  };
  const auto mark = [&](const auto& obstacle) {
    const Box box = box_of(obstacle);
    if (box.xmin > problem.bounds[2] + clear || box.xmax < x0_ - clear || box.ymin > problem.bounds[3] + clear ||
        box.ymax < y0_ - clear) {
      return;
    }
    const std::size_t last_row = index(y0_, box.ymax + clear, rows_);
    const std::size_t last_column = index(x0_, box.xmax + clear, columns_);
    for (std::size_t row = index(y0_, box.ymin - clear, rows_); row <= last_row; ++row) {
      for (std::size_t column = index(x0_, box.xmin - clear, columns_); column <= last_column; ++column) {
        std::uint8_t& cell = cells_[row * columns_ + column];
        if (cell & kHit) {
          continue;
        }
        const double d = distance(Point{x0_ + (column + 0.5) * size, y0_ + (row + 0.5) * size}, obstacle);
        if (d < hit) {
          cell = kHit;
        } else if (d <= clear) {
          cell &= static_cast<std::uint8_t>(~kClear);
        }
      }
    }
  };
  std::for_each(problem.triangles.begin(), problem.triangles.end(), mark);
  std::for_each(problem.discs.begin(), problem.discs.end(), mark);
}

}  // namespace trailmark

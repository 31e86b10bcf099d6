#include "placement_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "distance.hpp"

namespace trailmark {
namespace {

constexpr double kMaxCells = 1 << 18;
constexpr double kMaxSide = 8192;    // cells along a side
constexpr double kRounding = 1e-9;  // relative; keeps verdicts on the safe side

// Squared distances along a line of cells from the nearest site, whose own squared distance is given; in place.
// Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions" (2012), algorithm 1.
void transform(std::vector<double>& line) {
  const std::size_t count = line.size();
  static thread_local std::vector<std::size_t> site;
  static thread_local std::vector<double> from, given;
  site.assign(count, 0);
  from.assign(count + 1, 0.0);
  given = line;
  std::size_t last = 0;
  from[0] = -std::numeric_limits<double>::infinity();
  for (std::size_t q = 1; q < count; ++q) {
    const auto meet = [&](std::size_t p) {
      return ((given[q] + 1.0 * q * q) - (given[p] + 1.0 * p * p)) / (2.0 * (q - p));
    };
    double s = meet(site[last]);
    while (last > 0 && s <= from[last]) {
      s = meet(site[--last]);
    }
    if (last == 0 && s <= from[0]) {
      continue;
    }
    site[++last] = q;
    from[last] = s;
  }
  std::size_t k = 0;
  for (std::size_t q = 0; q < count; ++q) {
    while (k < last && from[k + 1] < static_cast<double>(q)) {
      ++k;
    }
    const double d = static_cast<double>(q) - static_cast<double>(site[k]);
    line[q] = d * d + given[site[k]];
  }
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

PlacementGrid::PlacementGrid(const Problem& problem, bool distances) {
  const double width = problem.bounds[2] - problem.bounds[0], height = problem.bounds[3] - problem.bounds[1];
  const double size = std::max({0.25 * problem.robot.inscribed.radius, std::sqrt(width * height / kMaxCells),
                                std::max(width, height) / kMaxSide});
  x0_ = problem.bounds[0];
  y0_ = problem.bounds[1];
  per_metre_ = 1.0 / size;
  columns_ = static_cast<std::size_t>(std::ceil(width / size));
  rows_ = static_cast<std::size_t>(std::ceil(height / size));
  cells_.assign(columns_ * rows_, kClear);
  if (distances) {
    distances_.assign(cells_.size(), std::numeric_limits<float>::infinity());
  }

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
        if (cell & kHit && !distances) {
          continue;
        }
        const double d = distance_of(Point{x0_ + (column + 0.5) * size, y0_ + (row + 0.5) * size}, obstacle);
        if (distances) {
          float& known = distances_[row * columns_ + column];
          // Of what is farther not all obstacles know.
          known = d <= clear ? std::min(known, static_cast<float>(d)) : known;
        }
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
  if (distances) {
    spread_distances(size, half);
  }
}

// So far, the cells near obstacles know their centre's distance. The others get theirs from the cells that obstacles
// touch: an obstacle's point is at most `half` from the centre of the cell that it lies in.
void PlacementGrid::spread_distances(double size, double half) {
  const double nothing = 4.0 * static_cast<double>(columns_ + rows_) * static_cast<double>(columns_ + rows_);
  std::vector<double> squared(cells_.size()), line;
  for (std::size_t i = 0; i < squared.size(); ++i) {
    squared[i] = distances_[i] <= half * (1.0 + kRounding) ? 0.0 : nothing;
  }
  const auto pass = [&](std::size_t lines, std::size_t length, std::size_t across, std::size_t along) {
    line.resize(length);
    for (std::size_t i = 0; i < lines; ++i) {
      for (std::size_t j = 0; j < length; ++j) {
        line[j] = squared[i * across + j * along];
      }
      transform(line);
      for (std::size_t j = 0; j < length; ++j) {
        squared[i * across + j * along] = line[j];
      }
    }
  };
  pass(rows_, columns_, columns_, 1);
  pass(columns_, rows_, 1, columns_);
  for (std::size_t i = 0; i < squared.size(); ++i) {
    // Single precision, hence the share that is taken off.
    const double far = std::sqrt(squared[i]) * size - half, near = static_cast<double>(distances_[i]);
    distances_[i] = static_cast<float>(((std::isfinite(near) ? near : far) - half) * (1.0 - 1e-6) - 1e-9);
  }
}

}  // namespace trailmark

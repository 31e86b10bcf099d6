// PlacementGrid: where the obstacles leave no doubt. The same idea as the inscribed and circumscribed radius of a
// costmap: of a cell is known whether a disc about any point in it is clear of all obstacles, or hits one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "problem.hpp"

namespace trailmark {

class PlacementGrid {
 public:
  // Cells are a quarter of the inscribed radius wide, larger where that would take more than 2^18 of them.
  // distances: whether they know distances too.
  explicit PlacementGrid(const Problem& problem, bool distances = false);

  // Whether the disc that holds the whole robot, about (x, y), is clear of all obstacles. No: not known.
  bool circumscribed_is_clear(double x, double y) const { return verdict(x, y) & kClear; }

  // Of (x, y) from all obstacles, metres, never more than it is; 0 outside the bounds. Only of a grid with distances.
  double distance(double x, double y) const {
    const std::size_t cell = index(x, y);
    return cell == cells_.size() ? 0.0 : static_cast<double>(distances_[cell]);
  }

  // Whether the inscribed disc, its centre at (x, y), overlaps an obstacle. No: not known.
  bool inscribed_hits(double x, double y) const { return verdict(x, y) & kHit; }

 private:
  static constexpr std::uint8_t kClear = 1;
  static constexpr std::uint8_t kHit = 2;

  // The cell that holds a point; the number of cells outside the bounds, where nothing is known, and for NaN.
  std::size_t index(double x, double y) const {
    const double column = (x - x0_) * per_metre_;
    const double row = (y - y0_) * per_metre_;
    if (!(column >= 0.0 && row >= 0.0 && column < columns_ && row < rows_)) {
      return cells_.size();
    }
    return static_cast<std::size_t>(row) * columns_ + static_cast<std::size_t>(column);
  }

  std::uint8_t verdict(double x, double y) const {
    const std::size_t cell = index(x, y);
    return cell == cells_.size() ? 0 : cells_[cell];
  }

  void spread_distances(double size, double half);

  double x0_, y0_, per_metre_;
  std::size_t columns_, rows_;
  std::vector<std::uint8_t> cells_;
  std::vector<float> distances_;  // of any point of a cell, at least
};

}  // namespace trailmark

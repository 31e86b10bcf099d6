// Checker: is a configuration valid, and how far is it from what is not? The bounds first, then what the grid is sure of,
// then FCL.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <fcl/fcl.h>
#include <memory>
#include <optional>
#include <vector>

#include "placement_grid.hpp"
#include "problem.hpp"
#include "triangle_tiles.hpp"

namespace trailmark {

class Checker {
 public:
  enum class Kind {
    kFast,
    kPlain,       // all that is within the bounds goes to FCL, in a single model of all triangles (to compare with)
    kClearances,  // measures clearances too
  };

  explicit Checker(const Problem& problem, Kind kind = Kind::kFast);

  // Whether the robot at (x, y, theta) overlaps no obstacle and stays within the bounds; touching is allowed.
  bool valid(double x, double y, double theta) const;

  // A lower bound (metres) on the robot's distance from obstacles and bounds; 0 or less: it is not valid, or touches.
  // The disc about the robot is looked up in the grid, then discs that cover it; where those are not far from obstacles,
  // FCL measures. Only of a checker of that kind.
  double clearance(double x, double y, double theta) const;

  // Configurations checked so far. Planners check from one thread at a time: no locked addition is needed.
  std::uint64_t checked() const { return checked_.load(std::memory_order_relaxed); }

 private:
  double from_bounds(double x, double y, double cos, double sin) const;
  bool overlaps(double x, double y, double cos, double sin) const;
  double from_obstacles(double x, double y, double cos, double sin) const;

  std::array<double, 4> bounds_;  // grown by the touching tolerance
  double circumradius_;
  double margin_;  // metres; larger distances from polygons FCL need not find
  bool round_;
  Disc inscribed_;
  bool centred_;  // the inscribed disc's centre is the reference point
  std::vector<Point> hull_;
  std::vector<Disc> cover_;  // discs in the robot's frame that hold all of it
  std::optional<PlacementGrid> grid_;
  std::vector<Triangle> triangles_;  // of the robot
  std::shared_ptr<fcl::CollisionGeometryd> robot_;
  TriangleTiles polygons_;
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> discs_;
  std::unique_ptr<fcl::DynamicAABBTreeCollisionManagerd> disc_manager_;
  mutable std::atomic<std::uint64_t> checked_{0};
};

}  // namespace trailmark

// The forces that there are, by the names under which Python makes them.
#include "forces/table.hpp"

#include <map>
#include <stdexcept>

namespace clothsim {

// Each is defined in the file of its force.
std::shared_ptr<const Force> make_drag(std::string name, std::vector<double> values, Motion motion);
std::shared_ptr<const Force> make_wind(std::string name, std::vector<double> values, Motion motion);

namespace {

using Make = std::shared_ptr<const Force> (*)(std::string, std::vector<double>, Motion);
const std::map<std::string, Make> table{
    {"drag", make_drag},
    {"wind", make_wind},
};

}  // namespace

std::shared_ptr<const Force> make_force(const std::string& name, std::vector<double> values,
                                        Motion motion) {
    const auto entry = table.find(name);
    if (entry == table.end()) throw std::invalid_argument("no force has the name " + name);
    return entry->second(name, std::move(values), std::move(motion));
}

}  // namespace clothsim

from stoop.base.notices import attempt as attempt
from stoop.base.notices import notice as notice
